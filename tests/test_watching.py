"""tf2_monitor and tf2_check, as processes of their own, beside one that broadcasts."""

import json
import os
import re
import signal
import sys
import time
from xml.etree import ElementTree

import pytest
from making import S
from processes import DEADLINE_S, broadcasting, ended, running

from tf2_ros._traffic.findings import KINDS

pytestmark = pytest.mark.ours

FAULTS = {
    ("roots", ""),
    ("loop", "loop_a"),
    ("parents", "two_parents"),
    ("publishers", "two_publishers"),
    ("mixed", "static_and_dynamic"),
    ("stale", "stopped"),
    ("future", "ahead"),
    ("gap", "with_gaps"),
    ("rate", "slow"),
    ("refused", "broken"),
}
HOSTILE, ESCAPED = "x\x1b[2J\x01\nok: 1 frames", r"x\x1b[2J\x01\nok: 1 frames"
# On a busy machine a healthy robot has gaps, too.
TOLERANT = ("--ignore", "gap")
# Without the robot of the other tests.
ALONE = ("-r", "/tf:=/tf_alone", "-r", "/tf_static:=/tf_static_alone")


@pytest.fixture(scope="module")
def robot():
    with broadcasting() as process:
        yield process


def reports(process, count):
    lines = [process.stdout.readline() for _ in range(count)]
    assert all(lines), process.communicate()[1]
    return [json.loads(line) for line in lines]


def first_report(process, condition):
    """The first one that fulfils it: discovery takes a while."""
    end = time.monotonic() + DEADLINE_S
    while time.monotonic() < end:
        [report] = reports(process, 1)
        if condition(report):
            return report
    raise AssertionError(f"none does; the last one is {report}")


def first_line(process, pattern):
    end = time.monotonic() + DEADLINE_S
    seen = []
    while time.monotonic() < end:
        seen.append(process.stdout.readline().rstrip())
        if re.fullmatch(pattern, seen[-1]):
            return
    raise AssertionError(f"none of {seen}")


def frames(report):
    return {stream["frame"]: stream for stream in report["streams"]}


class TestCheck:
    def test_finds_each_planted_fault(self, tmp_path):
        expected, path = tmp_path / "robot.yaml", tmp_path / "check.xml"
        expected.write_text("frames:\n  arm: {parent: base_link}\n  odom: {parent: base_link}\n")
        with broadcasting("faults"):
            options = ("-t", 5, "--min-rate", 15, "--junit", path, "--expect", expected)
            status, out, err = ended("tf2_check", *map(str, options))
        assert status == 1
        assert all("TF_DENORMALIZED_QUATERNION" in line for line in err.splitlines()), err
        *findings, verdict = out.splitlines()
        assert re.fullmatch(rf"wrong: {len(findings)} findings in 13 frames, \d+ messages and 5 s", verdict)
        said = {tuple(line.split(": ", 1)) for line in findings}
        wanted = {
            ("loop", "the frames loop_a -> loop_b -> loop_a form a loop"),
            ("roots", "2 unconnected trees: map (11 frames), sea (2 frames)"),
            ("parents", "two_parents has 2 parents in turn: map, odom"),
            ("publishers", "two_publishers is published by 2 publishers: /fleet/robot, /intruder"),
            ("mixed", "static_and_dynamic is static by /fleet/robot and dynamic by /fleet/robot"),
            ("missing", "arm is expected, and nobody publishes it"),
            ("parent", "odom has the parent map, not base_link"),
        }
        assert wanted <= said
        by_frame = {(kind, text.split()[0]) for kind, text in said}
        assert {pair for pair in FAULTS if pair[0] in ("stale", "future", "gap", "rate")} <= by_frame

        junit = ElementTree.parse(path).getroot()
        assert (junit.tag, junit.get("name"), junit.get("tests")) == (
            "testsuite",
            "tf2_check",
            str(len(KINDS)),
        )
        failures = {case.get("name"): case.find("failure") for case in junit}
        failed = {name for name, failure in failures.items() if failure is not None}
        assert failed == {kind for kind, _ in said}
        assert junit.get("failures") == str(len(failed))
        assert "two_parents has 2 parents in turn: map, odom" in failures["parents"].text

    def test_a_healthy_robot_passes(self, robot, tmp_path):
        path = tmp_path / "robot.yaml"
        path.write_text(
            "frames:\n"
            "  base_link: {parent: odom, min_rate: 10, max_delay: 2, static: false}\n"
            "  camera: {parent: base_link, static: true}\n"
        )
        junit = tmp_path / "check.xml"
        status, out, err = ended(
            "tf2_check", "-t", "3", *TOLERANT, "--expect", str(path), "--junit", str(junit)
        )
        assert (status, err) == (0, "")
        assert re.fullmatch(r"ok: no findings in 3 frames, \d+ messages and 3 s\n", out)
        suite = ElementTree.parse(junit).getroot()
        assert suite.get("failures") == "0"
        assert [case.get("name") for case in suite if case.find("skipped") is not None] == ["gap"]

    def test_names_cannot_write_lines_of_their_own(self, peer, tmp_path):
        junit, topics = tmp_path / "check.xml", ("-r", "/tf:=/hostile", "-r", "/tf_static:=/hostile_static")
        options = ("-t", "3", "--junit", str(junit), "--ros-args", *topics)
        with running("tf2_check", *options) as process:
            peer(*topics).send((HOSTILE, "a", S, 1.0), ("other", "b", S, 1.0))
            out, _ = process.communicate(timeout=DEADLINE_S)
        said = f"2 unconnected trees: other (2 frames), {ESCAPED} (2 frames)"
        assert out.splitlines()[0] == f"roots: {said}"
        assert f"\n{said}\n" in f"\n{ElementTree.parse(junit).getroot().findtext('testcase/failure')}\n"

    def test_silence_is_wrong(self):
        status, out, _ = ended("tf2_check", "-t", "0.2", "--ros-args", *ALONE)
        assert (status, out.splitlines()[0]) == (1, "nothing: no transform was received")

    @pytest.mark.parametrize(
        ("given", "said"),
        [
            (["-t", "0"], "argument -t: must be above 0, not 0"),
            (["--ignore", "weather"], "--ignore: weather is none of nothing, roots"),
            (["--expect", "/no/such/file"], "/no/such/file: No such file or directory"),
            (["--junit", "/no/such/folder/x.xml", "-t", "0.1"], "/no/such/folder/x.xml: No such file"),
        ],
    )
    def test_what_it_cannot_do_is_one_line_and_status_2(self, given, said):
        status, _, err = ended("tf2_check", *given)
        assert status == 2
        assert err.startswith(f"tf2_check: {said}")
        assert err.count("\n") == 1

    def test_expectations_that_are_not_understood_are_told(self, tmp_path):
        path = tmp_path / "robot.yaml"
        path.write_text("frames: {odom: {rate: 3}}")
        status, _, err = ended("tf2_check", "--expect", str(path))
        assert status == 2
        assert err.startswith(f"tf2_check: {path}: odom: rate is none of parent, static, min_rate")

    def test_interrupted_it_has_no_verdict(self, peer):
        with running("tf2_check", "-t", "3600", "--ros-args", *ALONE) as process:
            peer(*ALONE).matched(1)
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=DEADLINE_S)
        assert (process.returncode, out, err) == (130, "", "")


class TestMonitor:
    def test_json_has_the_figures_of_each_frame(self, robot):
        with running("tf2_monitor", "--json", "--interval", "1") as process:
            report = first_report(process, lambda one: frames(one).get("odom", {}).get("count", 0) > 50)
        found = frames(report)
        assert set(found) == {"odom", "base_link", "camera"}
        base = found["base_link"]
        assert (base["parent"], base["publisher"], base["static"]) == ("odom", "/fleet/robot", False)
        assert 20 < base["rate"] < 60
        assert 0 < base["delay"] < base["delay_max"] < 2
        assert 0 < base["jitter"] < 1
        assert found["camera"]["static"]
        assert {one["kind"] for one in report["findings"]} <= {"gap"}
        assert (report["chain"], report["lost"], report["malformed"]) == (None, 0, 0)

    def test_between_two_frames_it_tells_chain_and_net_delay(self, robot):
        with running("tf2_monitor", "/camera", "map", "--json", "--interval", "1") as process:
            chain = first_report(process, lambda one: one["chain"]["delay"])["chain"]
        assert chain["frames"] == ["camera", "base_link", "odom", "map"]
        mean, most = chain["delay"]
        assert 0.005 < mean < most < 2

    def test_text_has_a_line_for_each_frame(self, robot):
        with running("tf2_monitor", "map", "base_link", "--interval", "1.5") as process:
            figures = r"\d+\.\d Hz, delay \d+\.\d ms, max \d+\.\d ms, jitter \d+\.\d ms"
            first_line(process, r"at \d+\.\d{3} s")
            first_line(process, f"  base_link: parent odom, publisher /fleet/robot, {figures}")
            first_line(process, f"  odom: parent map, publisher /fleet/robot, {figures}")
            first_line(process, r"  map -> odom -> base_link: net delay \d+\.\d ms, max \d+\.\d ms")

    def test_frames_that_are_not_connected_are_told(self, robot):
        with running("tf2_monitor", "map", "moon", "--interval", "1") as process:
            first_line(process, "  odom: parent map, .*")
            first_line(process, "  map and moon are not connected")

    def test_a_terminal_shows_a_table(self, robot):
        pexpect = pytest.importorskip("pexpect")
        pytest.importorskip("rich")
        command = ["-m", "tf2_ros.cli.tf2_monitor", "map", "camera"]
        # readline, which pytest imports, sets the size of another terminal.
        environment = {name: os.environ[name] for name in os.environ if name not in ("COLUMNS", "LINES")}
        child = pexpect.spawn(
            sys.executable,
            command,
            encoding="utf-8",
            timeout=DEADLINE_S,
            dimensions=(40, 140),
            env={**environment, "TERM": "xterm"},
        )
        try:
            for _ in range(2):
                child.expect(r"map -> odom -> base_link -> camera: net delay [0-9.]+ ms, max [0-9.]+ ms")
                for title in (
                    "frame",
                    "parent",
                    "publisher",
                    "Hz",
                    "delay ms",
                    "max ms",
                    "jitter ms",
                    "wrong",
                ):
                    child.expect_exact(title)
                child.expect(r"base_link.*odom.*/fleet/robot.*\d\d\.\d")
                child.expect(r"camera.*base_link.*/fleet/robot.*static")
            child.sendintr()
            rest = child.read()
        finally:
            child.close(force=True)
        assert "Traceback" not in rest
        assert child.exitstatus == 0

    @pytest.mark.parametrize("term", ["xterm", "dumb"])
    def test_names_cannot_steer_the_terminal(self, term, peer):
        pexpect = pytest.importorskip("pexpect")
        pytest.importorskip("rich")
        topic = ("-r", "/tf_static:=/tf_hostile_static", "-r", "/tf:=/tf_hostile")
        command = ["-m", "tf2_ros.cli.tf2_monitor", "--ros-args", *topic]
        environment = {name: os.environ[name] for name in os.environ if name not in ("COLUMNS", "LINES")}
        with pexpect.spawn(
            sys.executable,
            command,
            encoding="utf-8",
            timeout=DEADLINE_S,
            dimensions=(40, 180),
            env={**environment, "TERM": term},
        ) as child:
            peer(*topic).send((HOSTILE, "camera", S, 1.0), static=True)
            child.expect_exact(ESCAPED)
            child.sendintr()
            child.expect(pexpect.EOF)

    def test_a_terminal_that_cannot_draw_gets_lines(self, robot):
        pexpect = pytest.importorskip("pexpect")
        command = ["-m", "tf2_ros.cli.tf2_monitor"]
        with pexpect.spawn(
            sys.executable, command, encoding="utf-8", timeout=DEADLINE_S, env={**os.environ, "TERM": "dumb"}
        ) as child:
            child.expect(r"^at \d+\.\d{3} s\r\n  base_link: parent odom, ")
            child.sendintr()
            child.expect(pexpect.EOF)

    def test_it_warns_of_planted_faults(self):
        kinds = set()
        with (
            broadcasting("faults"),
            running("tf2_monitor", "--json", "--interval", "1", "--min-rate", "15") as process,
        ):

            def all_found(report):
                kinds.update((one["kind"], one["frame"]) for one in report["findings"])
                return kinds >= FAULTS

            first_report(process, all_found)

    def test_delays_are_those_of_simulated_time(self, peer):
        talker = peer(*ALONE)
        options = ("--json", "--interval", "0.2", "--ros-args", "-p", "use_sim_time:=true", *ALONE)
        with running("tf2_monitor", *options) as process:

            def is_known(report):
                # Sent again, until it was discovered.
                talker.set_clock(100)
                talker.send(("map", "simulated", 97 * S, 0.0))
                return frames(report).get("simulated", {}).get("delay")

            delay = frames(first_report(process, is_known))["simulated"]["delay"]
        assert delay == pytest.approx(3.0)

    @pytest.mark.parametrize("frames", [["map"], ["map", "odom", "camera"]])
    def test_one_frame_or_three_are_wrong_usage(self, frames):
        status, out, err = ended("tf2_monitor", *frames)
        assert (status, out) == (2, "")
        assert err == f"tf2_monitor: two frames, or none, not {len(frames)} (see tf2_monitor --help)\n"

    @pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
    def test_a_signal_ends_it_without_a_trace(self, robot, how):
        with running("tf2_monitor", "--interval", "0.5") as process:
            assert process.stdout.readline()
            process.send_signal(how)
            _, err = process.communicate(timeout=DEADLINE_S)
        assert (process.returncode, err) == (0, "")
