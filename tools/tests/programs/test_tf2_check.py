"""tf2_check, as a process of its own, beside others that broadcast."""

import json
import re
import subprocess
import threading
import time

import pytest
from making import S
from processes import DEADLINE_S, until
from rclpy.qos import QoSProfile, ReliabilityPolicy
from starting import ROBOT, UNTIL_TOLD, broadcasting, ended, heard, running

from tf2_msgs.msg import TFMessage

pytestmark = pytest.mark.ours

# On a busy machine a healthy robot has gaps, too.
TOLERANT = ("--ignore", "gap", "--ignore", "stale")
SIMULATED = ("-p", "use_sim_time:=true")
CLOCKS = "clocks: the stamps of base by /peer are"


def test_a_healthy_robot_passes(tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_text("frames: {base_link: {parent: odom, min_rate: 1, max_delay: 2, static: false}}")
    with broadcasting():
        status, out, err = ended("tf2_check", "-t", "6", *TOLERANT, "--expect", str(path), hears=ROBOT)
    assert (status, err) == (0, "")
    assert re.fullmatch(r"ok: no findings in 4 frames, \d+ messages and 6 s\n", out)


def test_json_has_the_verdict_the_findings_and_the_figures(peer):
    talker = peer()
    talker.send_without_subscriber(("map", "b", S, 1.0), ("sea", "isle", S, 1.0), static=True)
    with running("tf2_check", "--json", hears=f"{heard('b', 'isle')} and len(findings) > 1") as process:
        talker.send_bytes(b"\x00\x01")
        out, err = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 1 and "malformed TFMessage" in err
    found = json.loads(out)
    text = "2 unconnected trees: map (2 frames), sea (2 frames)"
    roots = {"kind": "roots", "frame": "", "text": text, "frames": []}
    text = "1 message could not be read"
    malformed = {"kind": "malformed", "frame": "", "text": text, "frames": []}
    assert (found["ok"], found["seconds"], found["findings"]) == (False, 5.0, [roots, malformed])
    assert {stream["frame"] for stream in found["streams"]} == {"b", "isle"}


@pytest.mark.parametrize(
    ("options", "offset", "simulated", "said"),
    [
        ([], 1_600_000_000 * S, None, rf"{CLOCKS} [\d.]+ years behind .* \(see use_sim_time\), .*"),
        (SIMULATED, 0, 100, rf"{CLOCKS} [\d.]+ years ahead of .* \(see use_sim_time\), .*"),
        (SIMULATED, 0, None, "clock: use_sim_time is set, and no time was received on /clock, .*"),
    ],
    ids=["robot simulated", "tool simulated", "without a clock"],
)
def test_a_clock_that_is_wrong_is_found(options, offset, simulated, said, peer):
    talker = peer()
    talker.send_without_subscriber(("base", "camera", S, 1.0), static=True)
    hears = f"{heard('camera')} and any('clock' in one for one in findings)"
    with running("tf2_check", *TOLERANT, "--ros-args", *options, hears=hears) as process:
        while process.poll() is None:
            if simulated is not None:
                talker.set_clock(simulated)
            talker.send_without_subscriber(("map", "base", time.time_ns() - offset, 0.0))
            threading.Event().wait(0.05)  # as a robot does
        out, _ = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 1
    finding, verdict = out.splitlines()
    assert re.fullmatch(said, finding)
    assert verdict.startswith("wrong: 1 finding in ")


def test_two_publishers_of_the_clock_are_named(peer):
    talkers = peer("-r", "__node:=player"), peer("-r", "__node:=simulator")

    def publish():
        for talker, seconds in zip(talkers, (100, 500), strict=True):
            talker.set_clock(seconds, subscribed=False)
            talker.send_without_subscriber(("map", "base", seconds * S, 0.0))

    publish()
    hears = "any('/clock has 2 publishers, /player and /simulator' in one for one in findings)"
    with running("tf2_check", *TOLERANT, "--ros-args", *SIMULATED, hears=hears) as process:
        while process.poll() is None:
            publish()
            threading.Event().wait(0.05)
        out, _ = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 1
    [finding] = [line for line in out.splitlines() if line.startswith("clock: ")]
    several = "/clock has 2 publishers, /player and /simulator"
    jump = f"the clock jumped back by 400 s: {several}; only what was received after that is judged"
    assert finding in (
        f"clock: {jump}",
        f"clock: {several}: a jump from one time to the other clears buffers",
    )


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
    name = f"unfit_{topic[1:]}"
    line = ("--json", "--ignore", "nothing", "--ignore", "clock")
    with running("tf2_check", *line, hears=UNTIL_TOLD, stdin=subprocess.PIPE) as process:
        profile = QoSProfile(depth=1, **qos)
        new_node(name, namespace="/fleet").create_publisher(TFMessage, topic, profile)
        # The listener's own log names it, too.
        log = f"Nothing is received from /fleet/{name} on {topic}: {reason[0].upper()}{reason[1:]}\n"
        until(lambda: log in process.stderr.readline())
        out, _ = process.communicate(timeout=DEADLINE_S)
    text = f"listeners receive nothing from /fleet/{name} on {topic}: {reason}"
    found = json.loads(out)["findings"]
    assert {"kind": "qos", "frame": "", "text": text, "frames": []} in found
