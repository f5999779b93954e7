"""tf2_monitor and tf2_check, as processes of their own, beside one that broadcasts."""

import json
import re
import threading
import time

import pytest
from making import S
from processes import DEADLINE_S, until
from rclpy.qos import QoSProfile, ReliabilityPolicy
from starting import broadcasting, ended, running

from tf2_msgs.msg import TFMessage

pytestmark = pytest.mark.ours

HOSTILE, ESCAPED = "x\x1b[2J\x01\nok: 1 frames", r"x\x1b[2J\x01\nok: 1 frames"
# On a busy machine a healthy robot has gaps, too.
TOLERANT = ("--ignore", "gap")
# Without the robot of the other tests.
ALONE = ("-r", "/tf:=/tf_alone", "-r", "/tf_static:=/tf_static_alone")
SIMULATED = ("-p", "use_sim_time:=true")
CLOCKS = "clocks: the stamps of base by /peer are"


@pytest.fixture(scope="module")
def robot():
    with broadcasting() as process:
        yield process


def frames(report):
    return {stream["frame"]: stream for stream in report["streams"]}


class TestCheck:
    def test_a_healthy_robot_passes(self, robot, tmp_path):
        path = tmp_path / "robot.yaml"
        path.write_text("frames: {base_link: {parent: odom, min_rate: 10, max_delay: 2, static: false}}")
        status, out, err = ended("tf2_check", "-t", "6", *TOLERANT, "--expect", str(path))
        assert (status, err) == (0, "")
        assert re.fullmatch(r"ok: no findings in 4 frames, \d+ messages and 6 s\n", out)

    def test_json_has_the_verdict_the_findings_and_the_figures(self, peer):
        with running("tf2_check", "--json", "--ros-args", *ALONE) as process:
            talker = peer(*ALONE)
            talker.send(("map", "b", S, 1.0), ("sea", "isle", S, 1.0), static=True)
            talker.send_bytes(b"\x00\x01", "/tf_alone")
            out, err = process.communicate(timeout=DEADLINE_S)
        assert process.returncode == 1 and "malformed TFMessage" in err
        found = json.loads(out)
        text = "2 unconnected trees: map (2 frames), sea (2 frames)"
        roots = {"kind": "roots", "frame": "", "text": text, "frames": []}
        text = "1 message could not be read"
        malformed = {"kind": "malformed", "frame": "", "text": text, "frames": []}
        assert (found["ok"], found["seconds"], found["findings"]) == (False, 5.0, [roots, malformed])
        assert {*frames(found)} == {"b", "isle"}

    @pytest.mark.parametrize(
        ("options", "offset", "simulated", "said"),
        [
            ([], 1_600_000_000 * S, None, rf"{CLOCKS} [\d.]+ years behind .* \(see use_sim_time\), .*"),
            (SIMULATED, 0, 100, rf"{CLOCKS} [\d.]+ years ahead of .* \(see use_sim_time\), .*"),
            (SIMULATED, 0, None, "clock: use_sim_time is set, and no time was received on /clock, .*"),
        ],
        ids=["robot simulated", "tool simulated", "without a clock"],
    )
    def test_a_clock_that_is_wrong_is_found(self, options, offset, simulated, said, peer):
        talker = peer(*ALONE)
        talker.send_without_subscriber(("base", "camera", S, 1.0), static=True)
        with running("tf2_check", *TOLERANT, "--ros-args", *options, *ALONE) as process:
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

    def test_two_publishers_of_the_clock_are_named(self, peer):
        with running("tf2_check", *TOLERANT, "--ros-args", *SIMULATED, *ALONE) as process:
            talkers = peer(*ALONE, "-r", "__node:=player"), peer(*ALONE, "-r", "__node:=simulator")
            while process.poll() is None:
                for talker, seconds in zip(talkers, (100, 500), strict=True):
                    talker.set_clock(seconds, subscribed=False)
                    talker.send_without_subscriber(("map", "base", seconds * S, 0.0))
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
    def test_a_publisher_whose_qos_does_not_fit_is_named(self, topic, qos, reason, new_node):
        with running("tf2_check", "--json", "--ignore", "nothing", "--ignore", "clock") as process:
            name = f"unfit_{topic[1:]}"
            profile = QoSProfile(depth=1, **qos)
            new_node(name, namespace="/fleet").create_publisher(TFMessage, topic, profile)
            out, err = process.communicate(timeout=DEADLINE_S)
        text = f"listeners receive nothing from /fleet/{name} on {topic}: {reason}"
        found = json.loads(out)["findings"]
        assert {"kind": "qos", "frame": "", "text": text, "frames": []} in found
        # The listener's own log names it, too, unless the graph does not know the node yet.
        named = f"(/fleet/{name}|an unknown node)"
        assert re.search(
            f"Nothing is received from {named} on {topic}: {reason[0].upper()}{reason[1:]}\n", err
        )


class TestMonitor:
    def test_json_has_the_figures_of_each_frame(self, robot):
        with running("tf2_monitor", "--json", "--interval", "1") as process:

            def known():
                report = json.loads(process.stdout.readline())
                base = frames(report).get("base_link", {})
                # The graph may know an endpoint before it knows its node.
                return base.get("count", 0) > 50 and base["publisher"] == "/fleet/robot" and report

            report = until(known)
        found = frames(report)
        assert set(found) == {"odom", "base_link", "camera"}
        base = found["base_link"]
        assert (base["parent"], base["publisher"], base["static"]) == ("odom", "/fleet/robot", False)
        assert 5 < base["rate"] < 60  # 50 on a machine that is not busy
        assert 0 < base["delay"] < base["delay_max"] < 2
        assert 0 < base["jitter"] < 1
        assert found["camera"]["static"]
        assert {one["kind"] for one in report["findings"]} <= {"gap"}
        assert report["chain"] is None

    def test_a_pipe_gets_what_scripts_for_tf2s_program_parse(self, robot):
        number = r"-?\d+(\.\d+)?(e[-+]\d+)?"
        figures = f"Average Delay: {number}, Max Delay: {number}"
        report = (
            "\n\n\nRESULTS: for camera to map\n"
            "Chain is: camera -> base_link -> odom -> map\n"
            f"Net delay     avg = {number}: max = {number}\n\n"
            "Frames:\n"
            f"Frame: base_link, published by /fleet/robot, {figures}\n"
            "Frame: camera, published by /fleet/robot, Average Delay: nan, Max Delay: nan\n"
            f"Frame: odom, published by /fleet/robot, {figures}\n\n"
            "All Broadcasters:\n"
            f"Node: /fleet/robot {number} Hz, {figures.replace(',', '')}\n"
        )
        with running("tf2_monitor", "camera", "map", "--interval", "1.5") as process:
            out = [process.stdout.readline()]
            assert out == ["Gathering data on camera -> map for 1.5 seconds...\n"]
            until(lambda: out.append(process.stdout.readline()) or re.search(report, "".join(out)))

    def test_a_pipe_gets_problems_after_all_of_that(self):
        with running("tf2_monitor", "--interval", "1", "--ros-args", *ALONE) as process:
            lines = [process.stdout.readline() for _ in range(12)]
        assert "".join(lines[:-1]) == (
            "Gathering data on all frames for 1.0 second...\n\n\n\n"
            "RESULTS: for all Frames\n\nFrames:\n\nAll Broadcasters:\n\nProblems:\n"
        )
        silence = "no transform was received on /tf_alone and /tf_static_alone in ROS domain"
        assert re.fullmatch(rf"{silence} \d+\n", lines[-1])

    @pytest.mark.parametrize("term", ["xterm", "dumb"])
    def test_names_cannot_steer_the_terminal(self, term, peer):
        pytest.importorskip("pexpect")
        from terminals import Terminal

        topic = ("-r", "/tf_static:=/tf_hostile_static", "-r", "/tf:=/tf_hostile")
        with Terminal(180, 40, "tf2_monitor", "--ros-args", *topic, TERM=term) as terminal:
            peer(*topic).send(("camera", HOSTILE, S, 1.0), static=True)
            terminal.shows(lambda lines: ESCAPED in "".join(lines))
            assert not any(line.startswith("ok: 1 frames") for line in terminal.lines)
