# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""tf2_check, as a process of its own, beside others that broadcast."""

import itertools
import json
import re
import tempfile
import threading
import time

import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from starting_programs import ROBOT, broadcasting, ended, heard, running
from times_and_transforms import S

from tf2_msgs.msg import TFMessage

# On a busy machine a healthy robot has gaps, too.
TOLERANT = ("--ignore", "gap", "--ignore", "stale")
LISTENING = re.compile(
    r"\[INFO\] \[[\d.]+\] \[tf2_check\]: Listening on /tf and /tf_static in ROS domain \d+ for \d+ s\.\.\.\n"
)
SIMULATED = ("-p", "use_sim_time:=true")
CLOCKS = "clocks: the stamps of base by /peer are"


def test_a_healthy_robot_passes(tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_text("frames: {base_link: {parent: odom, min_rate: 1, max_delay: 2, static: false}}")
    with broadcasting():
        status, out, err = ended("tf2_check", "-t", "6", *TOLERANT, "--expect", str(path), hears=ROBOT)
    assert status == 0 and LISTENING.fullmatch(err)
    assert re.fullmatch(r"no problems in 4 frames \(\d+ messages, 6 s\)\n", out)


def test_json_has_the_verdict_the_findings_and_the_figures(peer):
    talker = peer()
    talker.send_without_subscriber(("map", "b", S, 1.0), ("sea", "isle", S, 1.0), static=True)
    with running("tf2_check", "--json", hears=f"{heard('b', 'isle')} and len(findings) > 1") as process:
        talker.send_bytes(b"\x00\x01")
        out, err = process.communicate()
    assert process.returncode == 1 and "malformed TFMessage" in err
    found = json.loads(out)
    text = "2 unconnected trees: map (2 frames), sea (2 frames)"
    roots = {"kind": "roots", "frame": "", "text": text, "frames": []}
    text = "1 message could not be read"
    malformed = {"kind": "malformed", "frame": "", "text": text, "frames": []}
    assert (found["ok"], found["seconds"], found["findings"]) == (False, 5.0, [malformed, roots])
    assert {stream["frame"] for stream in found["streams"]} == {"b", "isle"}


def test_two_poses_at_one_stamp_are_found(peer):
    talker = peer()
    with running("tf2_check", "--json", hears=f"{heard(b=1)} and findings") as process:
        talker.send(("map", "b", 5 * S, 1.0), ("map", "b", 5 * S, 1.5))
        out, _ = process.communicate()
    texts = {one["kind"]: one["text"] for one in json.loads(out)["findings"]}
    said = "b in map has different poses at 1 stamp, up to 0.5 m and 0 degrees apart, first at 5.000 s"
    assert texts["values"] == f"{said}: lookups mix them"


def test_it_says_at_once_that_it_listens():
    with running("tf2_check", "-t", "1000") as process:
        assert process.stderr.readline().endswith(" for 1000 s...\n")


NOTHING = "nothing: no transform was received on /tf and /tf_static in ROS domain"


@pytest.mark.parametrize("program", ["tf2_check", "view_frames"])
def test_a_namespace_in_which_transforms_are_published_is_named(peer, program):
    peer("-r", "/tf:=/robot1/tf", "-r", "/tf_static:=/unused")
    arguments = ("--text",) if program == "view_frames" else ()
    _, out, err = ended(program, *arguments, hears="'/robot1/tf' in str(findings)")
    silence = r"no transform was received on /tf and /tf_static in ROS domain \d+"
    reason = r"\(transforms are published on /robot1/tf: add --namespace robot1\)"
    assert re.search(f"{silence} {reason}", out + err)


@pytest.mark.parametrize("also", [False, True])
def test_a_publisher_of_another_type_is_named(peer, also):
    board = peer("-r", "__node:=board", "-r", "/board:=/tf", "-r", "/tf:=/unused")
    board.send_text("/board")
    if also:
        peer().send_without_subscriber(("map", "camera", S, 1.0), static=True)
    found = f"' publishes std_msgs' in str(findings) and {heard('camera') if also else 'not streams'}"
    _, out, _ = ended("tf2_check", hears=f"{found} and told()")
    what = "/board publishes std_msgs/msg/String on /tf, not tf2_msgs/msg/TFMessage"
    finding = f"qos: listeners receive nothing: {what}" if also else rf"{NOTHING} \d+ \({what}\)"
    assert re.fullmatch(finding, out.splitlines()[0])


def checked(publish, hears, *arguments):
    """
    The lines that `tf2_check` prints while something is published, and what else it writes to standard error.

    :param hears: what it must have found, besides the names of all publishers.
    """
    hears = f"{hears} and told()"
    with tempfile.TemporaryFile("w+") as errors:  # a pipe might be full before the process has ended
        with running("tf2_check", *TOLERANT, *arguments, hears=hears, stderr=errors) as process:
            while process.poll() is None:
                publish()
                threading.Event().wait(0.05)  # as a robot does
            out = process.stdout.read()
        errors.seek(0)
        err = errors.read()
    assert process.returncode == 1, err
    return out.splitlines(), LISTENING.sub("", err)


def test_refused_transforms_are_counted_and_not_logged(peer):
    talker = peer()
    good, bad = ("map", "odom", 0, 0.0), ("map", "base", 0, float("nan"))

    def publish():
        now_ns = time.time_ns()
        talker.send_without_subscriber(*((*one[:2], now_ns, one[3]) for one in (good, bad)))

    (finding, _), err = checked(publish, f"findings and {heard(odom=9)}")
    assert re.fullmatch(r"refused: \d+ transforms of base by /peer are refused: a number is NaN", finding)
    assert err == ""


def test_a_static_transform_that_changes_is_shown_with_its_values(peer):
    talker, places = peer(), itertools.cycle((1.0, 2.0))

    def publish():
        talker.send_without_subscriber(("map", "lidar", S, next(places)), static=True)

    changed = "any(' times, last from ' in one for one in findings)"  # not after its first change
    (finding, _), _ = checked(publish, changed)
    alternating = r"values: lidar in map by /peer is static and changed \d+ times, last from x ... to x ..."
    assert re.match(alternating.replace("x ...", r"x [12]\.000"), finding)


@pytest.mark.parametrize(
    ("simulated", "said"),
    [
        (100, rf"{CLOCKS} [\d.]+ years ahead of .* \(see use_sim_time\), .*"),
        (None, "clock: use_sim_time is set, but /clock was not received, .*"),
    ],
    ids=["simulated", "without a clock"],
)
def test_a_clock_that_is_wrong_is_found(simulated, said, peer):
    talker = peer()
    talker.send_without_subscriber(("base", "camera", S, 1.0), static=True)

    def publish():
        if simulated is not None:
            talker.set_clock(simulated)
        talker.send_without_subscriber(("map", "base", time.time_ns(), 0.0))

    begin = " ".join(said.split()[1:3])  # until /clock is heard, the finding is another one
    hears = f"{heard('camera')} and any(one.startswith('{begin}') for one in findings)"
    (finding, verdict), _ = checked(publish, hears, "--ros-args", *SIMULATED)
    assert re.fullmatch(said, finding)
    assert verdict.startswith("1 problem in ")


def test_two_publishers_of_the_clock_are_named(peer):
    talkers = peer("-r", "__node:=player"), peer("-r", "__node:=simulator")

    def publish():
        for talker, seconds in zip(talkers, (100, 500), strict=True):
            talker.set_clock(seconds, subscribed=False)
            talker.send_without_subscriber(("map", "base", seconds * S, 0.0))

    publish()
    both = "any('/clock has 2 publishers, ' in one for one in findings)"
    lines, _ = checked(publish, both, "--ros-args", *SIMULATED)
    [finding] = [line for line in lines if line.startswith("clock: ")]
    several = "/clock has 2 publishers, /player and /simulator"
    jump = f"the clock jumped back by 400 s: {several}; earlier dynamic transforms are not checked"
    assert finding in (
        f"clock: {jump}",
        f"clock: {several}: each jump between their times clears buffers",
    )


def test_a_change_before_the_clock_jumped_back_has_no_negative_age(peer):
    talker = peer()
    # Mostly after the jump, because the report may come at any time.
    parents = itertools.cycle(["map", *[None] * 9, "rail", *[None] * 9])

    def publish():
        if (parent := next(parents)) is not None:
            talker.set_clock(500)
            talker.send_without_subscriber((parent, "lidar", S, 0.0), static=True)
        talker.set_clock(100)

    hears = "any(' changed ' in one and (', -' in one or ', before ' in one) for one in findings)"
    lines, _ = checked(publish, hears, "--ros-args", *SIMULATED)
    [finding] = [line for line in lines if line.startswith("values: ")]
    when = r"(before the clock jumped back|[\d.e-]+ s ago)"
    assert re.fullmatch(rf"values: lidar in .* to parent (map|rail), {when}: lookups .*", finding)
    assert ", -" not in finding


@pytest.mark.parametrize(
    ("topic", "qos", "reason"),
    [
        ("/tf_static", {}, "volatile publisher and transient local subscription"),
        (
            "/tf",
            {"reliability": ReliabilityPolicy.BEST_EFFORT},
            "best effort publisher and reliable subscription",
        ),
    ],
)
def test_a_publisher_whose_qos_does_not_fit_is_named(topic, qos, reason, new_node):
    name = f"incompatible_{topic[1:]}"
    new_node(name, namespace="/fleet").create_publisher(TFMessage, topic, QoSProfile(depth=1, **qos))
    hears = "any(one.startswith('listeners receive nothing from ') for one in findings) and told()"
    _, out, _ = ended("tf2_check", "--json", "--ignore", "nothing", "--ignore", "clock", hears=hears)
    text = f"listeners receive nothing from /fleet/{name} on {topic}: {reason}"
    assert {"kind": "qos", "frame": "", "text": text, "frames": []} in json.loads(out)["findings"]
