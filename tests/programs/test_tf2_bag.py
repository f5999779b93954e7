"""tf2_bag: its commands on recordings that the tests make, in this process, and a few in one of their own."""

import csv
import io
import json
import math
import os
import re
import signal
import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pytest
from making import transform
from making_bags import S, Sent, Tf, drive, scan, write_folder, write_mcap, write_ros1
from processes import DEADLINE_S, completed, ended, needs_dot, running, until

from tf2_ros_tools.bag import load
from tf2_ros_tools.findings import KINDS
from tf2_ros_tools.program import RunError, UsageError
from tf2_ros_tools.programs.tf2_bag import COMMANDS, bag, parser

pytestmark = pytest.mark.ours

SVG = "{http://www.w3.org/2000/svg}"
SCANS = [100 * S + i * S // 4 + 7 for i in range(12)]
COLUMNS = ("x", "y", "z", "qx", "qy", "qz", "qw")


def recording(path, *more, count=100):
    """Ten seconds of the robot, a lidar's messages, and more."""
    scans = [scan(stamp + 5_000_000, stamp) for stamp in SCANS]
    messages = sorted([*drive(count), *scans, *more], key=lambda one: one.log_ns)
    return str(write_mcap(path, messages))


@pytest.fixture(scope="module")
def drive_mcap(tmp_path_factory):
    return recording(tmp_path_factory.mktemp("bag") / "drive.mcap")


@pytest.fixture
def run(capsys):
    """Run a command line in this process: exit status, standard output and errors."""

    def run(*arguments):
        status = bag(parser().read(["tf2_bag", *map(str, arguments)]))
        return status, *capsys.readouterr()

    return run


def pose(buffer, stamp_ns, target="map", source="camera"):
    from rclpy.time import Time

    found = buffer.lookup_transform(target, source, Time(nanoseconds=stamp_ns)).transform
    v, q = found.translation, found.rotation
    return [v.x, v.y, v.z, q.x, q.y, q.z, q.w]


def rows_of(text):
    rows = list(csv.DictReader(io.StringIO(text)))
    stamps = [int(row["stamp_ns"]) for row in rows]
    return stamps, [[float(row[name]) for name in COLUMNS] for row in rows], [row["valid"] for row in rows]


class TestLookup:
    def test_each_row_is_what_a_single_lookup_gives(self, run, drive_mcap):
        status, out, err = run("lookup", drive_mcap, "map", "camera", "--rate", 7)
        stamps, poses, valid = rows_of(out)
        assert (status, err) == (0, "")
        assert stamps == [100 * S + round(i * S / 7) for i in range(int(9.9 * 7) + 1)]
        buffer = load(drive_mcap)
        assert poses == [pose(buffer, stamp) for stamp in stamps]
        assert set(valid) == {"true"}

    def test_by_default_the_times_are_the_stamps_of_what_moves_between(self, run, tmp_path):
        late = [Tf("base", "arm", 102 * S + i * S // 3, (0.0, i, 0.0)) for i in range(20)]
        path = recording(tmp_path / "a.mcap", *(Sent(one.ns + 10, "/tf", [one]) for one in late))
        status, out, err = run("lookup", path, "odom", "arm")
        stamps, poses, valid = rows_of(out)
        of_robot = {100 * S + i * S // 10 for i in range(100)}
        assert stamps == sorted(of_robot | {one.ns for one in late})
        known = [late[0].ns <= stamp <= late[-1].ns for stamp in stamps]
        assert valid == ["true" if one else "false" for one in known]
        buffer = load(path)
        unknown = [math.nan] * len(COLUMNS)
        expected = [
            pose(buffer, stamp, "odom", "arm") if one else unknown
            for stamp, one in zip(stamps, known, strict=True)
        ]
        assert np.array_equal(poses, expected, equal_nan=True)
        missing = f"{known.count(False)} of {len(stamps)}"
        assert (status, err) == (0, f"tf2_bag lookup: no answer at {missing} times\n")

    def test_what_does_not_move_is_one_row(self, run, drive_mcap):
        stamps, poses, _ = rows_of(run("lookup", drive_mcap, "base", "/camera")[1])
        assert (stamps, poses) == ([100 * S], [pose(load(drive_mcap), 0, "base", "camera")])

    def test_at_the_stamps_of_another_topic(self, run, drive_mcap):
        stamps, poses, _ = rows_of(run("lookup", drive_mcap, "map", "lidar", "--at", "/scan")[1])
        buffer = load(drive_mcap)
        assert stamps == SCANS
        assert poses == [pose(buffer, stamp, "map", "lidar") for stamp in SCANS]

    def test_at_given_times_to_the_nanosecond(self, run, drive_mcap, tmp_path):
        words = ["100.000000001", "101", "102.5"]
        stamps, poses, _ = rows_of(run("lookup", drive_mcap, "map", "camera", "--times", *words)[1])
        assert stamps == [100 * S + 1, 101 * S, 102_500_000_000]
        times = tmp_path / "times.txt"
        times.write_text("# a comment\n100.000000001 1 2 3\n\n101\n102.5,x\n")
        assert rows_of(run("lookup", drive_mcap, "map", "camera", "--times", times)[1])[:2] == (stamps, poses)

    def test_a_time_without_an_answer_is_nan_and_told(self, run, drive_mcap):
        status, out, err = run("lookup", drive_mcap, "map", "camera", "--times", "1", "101", "200")
        stamps, poses, valid = rows_of(out)
        assert (status, valid) == (0, ["false", "true", "false"])
        assert np.isnan(poses).all(axis=1).tolist() == [True, False, True]
        assert err == "tf2_bag lookup: no answer at 2 of 3 times\n"
        _, out, err = run("lookup", drive_mcap, "map", "camera", "--tum", "--times", "1", "101", "200")
        assert [line.split()[0] for line in out.splitlines()] == ["101.000000000"]
        assert err == "tf2_bag lookup: no answer at 2 of 3 times, which are left out\n"

    def test_the_time_0_is_not_the_latest_one(self, run, tmp_path):
        moving = [Sent(i * S, "/tf", [Tf("map", "base", i * S, (i, 0, 0))]) for i in range(5)]
        path = str(write_mcap(tmp_path / "sim.mcap", moving))
        stamps, poses, _ = rows_of(run("lookup", path, "map", "base", "--times", "0", "4")[1])
        assert stamps == [0, 4 * S]
        assert [row[0] for row in poses] == pytest.approx([0.0, 4.0], abs=1e-8)

    def test_all_formats_hold_the_same(self, run, drive_mcap, tmp_path):
        parquet = pytest.importorskip("pyarrow.parquet")

        ends = ("map", "camera", "--times", "1", "100.123456789", "105")
        stamps, poses, valid = rows_of(run("lookup", drive_mcap, *ends)[1])
        for name in ("a.csv", "a.tum", "a.npz", "a.parquet"):
            assert run("lookup", drive_mcap, *ends, "-o", tmp_path / name)[:2] == (0, f"{tmp_path / name}\n")
        of_csv = rows_of((tmp_path / "a.csv").read_text())
        assert (of_csv[0], of_csv[2]) == (stamps, valid)
        assert np.array_equal(of_csv[1], poses, equal_nan=True)
        lines = (tmp_path / "a.tum").read_text().splitlines()
        assert [line.split()[0] for line in lines] == ["100.123456789", "105.000000000"]
        assert [[*map(float, line.split()[1:])] for line in lines] == poses[1:]
        with np.load(tmp_path / "a.npz") as arrays:
            assert arrays["stamps_ns"].tolist() == stamps
            assert np.array_equal(
                np.hstack([arrays["translations"], arrays["rotations"]]), poses, equal_nan=True
            )
            assert arrays["valid"].tolist() == [False, True, True]
        table = parquet.read_table(tmp_path / "a.parquet").to_pydict()
        assert list(table) == ["file", "stamp", *COLUMNS, "valid"]
        assert (table["file"], table["stamp"]) == ([drive_mcap] * 3, stamps)
        assert table["valid"] == [False, True, True]
        assert np.array_equal(np.array([table[name] for name in COLUMNS]).T, poses, equal_nan=True)
        assert sorted(os.listdir(tmp_path)) == ["a.csv", "a.npz", "a.parquet", "a.tum"]

    def test_an_option_says_more_than_the_name_of_the_file(self, run, drive_mcap, tmp_path):
        run("lookup", drive_mcap, "map", "base", "--tum", "-o", tmp_path / "way.csv")
        assert len((tmp_path / "way.csv").read_text().splitlines()[0].split(" ")) == 8
        run("lookup", drive_mcap, "map", "base", "--csv", "-o", tmp_path / "way.data")
        assert (tmp_path / "way.data").read_text().startswith("stamp_ns,x,")

    def test_an_unknown_end_of_a_name_is_no_csv(self, run, drive_mcap, tmp_path):
        with pytest.raises(
            UsageError, match=r"way.xyz must end in .csv, .tum, .npz or .parquet, or say --csv"
        ):
            run("lookup", drive_mcap, "map", "base", "-o", tmp_path / "way.xyz")
        assert not list(tmp_path.iterdir())

    def test_the_times_may_be_those_of_its_own_csv(self, run, drive_mcap, tmp_path):
        run("lookup", drive_mcap, "map", "base", "--rate", 3, "-o", tmp_path / "way.csv")
        out = run("lookup", drive_mcap, "map", "base", "--times", tmp_path / "way.csv")[1]
        assert out == (tmp_path / "way.csv").read_text()

    @pytest.mark.parametrize(
        ("arguments", "said"),
        [
            (["map", "base", "--npz"], "--npz needs a file: -o FILE"),
            (["map", "base", "--parquet"], "--parquet needs a file: -o FILE"),
            (["map", "base", "--times", "1", "x"], "--times: 'x' is not a number"),
            (["map", "base", "--times", "/nothing/there"], "--times: /nothing/there: No such file"),
            (["map", "base", "--times", "1795210034251000000"], "--times must be seconds since 1970"),
            (["map", "base", "--start", "1e300"], "--start must be seconds"),
            (["map", "base", "--start", "5", "--end", "4"], "--end must not be before --start"),
        ],
    )
    def test_wrong_usage_is_refused(self, run, drive_mcap, arguments, said):
        with pytest.raises(UsageError, match=said):
            run("lookup", drive_mcap, *arguments)

    def test_a_line_of_times_that_is_no_number_is_named(self, run, drive_mcap, tmp_path):
        (tmp_path / "times").write_text("1.0\nstamp\n")
        with pytest.raises(UsageError, match="times, line 2: 'stamp' is not a number"):
            run("lookup", drive_mcap, "map", "base", "--times", tmp_path / "times")

    @pytest.mark.parametrize(
        ("arguments", "said"),
        [
            (["map", "nobody"], '"nobody" passed to lookupTransform argument source_frame does not exist'),
            (["map", "camera", "--rate", "1e9"], "makes 9900000001 times, more than 50000000"),
            (["map", "camera", "--times", "1"], "extrapolation into the past"),
            (["map", "camera", "--at", "/nothing"], "/nothing"),
        ],
    )
    def test_what_has_no_answer_at_all_is_told(self, drive_mcap, arguments, said):
        status, out, err = ended("tf2_bag", "lookup", drive_mcap, *arguments)
        assert (status, out, err.count("\n")) == (1, "", 1)
        assert err.startswith("tf2_bag lookup: ") and said in err

    def test_times_in_1970_are_called_what_the_option_takes_them_for(self, tmp_path):
        moving = [Sent(i, "/tf", [Tf("map", "base", 1_795_210_034 * S + i)]) for i in range(2)]
        path = str(write_mcap(tmp_path / "now.mcap", moving))
        status, _, err = ended("tf2_bag", "lookup", path, "map", "base", "--times", "1", "2")
        assert status == 1
        assert "Requested time 1.000000000 " in err and "nanoseconds" not in err
        assert "in 1970: is it in the wrong unit, or simulated time?" in err

    def test_unconnected_frames_are_told(self, run, tmp_path):
        path = recording(tmp_path / "a.mcap", Sent(100 * S, "/tf_static", [Tf("sea", "boat", 0)]))
        with pytest.raises(RunError, match="Tf has two or more unconnected trees"):
            run("lookup", path, "map", "boat", "--rate", "1")

    def test_no_times_are_told(self, run, tmp_path):
        mount = Sent(100 * S, "/tf_static", [Tf("base", "camera", 100 * S)])
        path = write_mcap(tmp_path / "mount.mcap", [mount], topics=[("/scan", "sensor_msgs/msg/LaserScan")])
        for when in (("--rate", 10), ("--at", "/scan")):
            with pytest.raises(RunError, match="the recording has no time to look up"):
                run("lookup", path, "base", "camera", *when)
        assert len(run("lookup", path, "base", "camera")[1].splitlines()) == 2

    def test_several_robots_get_prefixes(self, run, tmp_path):
        messages = [*drive(20, prefix="/one"), *drive(20, prefix="/two")]
        path = str(write_mcap(tmp_path / "two.mcap", sorted(messages, key=lambda one: one.log_ns)))
        topics = [
            f"--topic=/{robot}/{name}={robot}/" for robot in ("one", "two") for name in ("tf", "tf_static")
        ]
        status, out, _ = run("lookup", path, "two/map", "two/base", *topics)
        assert (status, len(out.splitlines())) == (0, 21)
        tree = run("tree", path, *topics)[1]
        assert {"one/map", "two/map"} <= set(tree.splitlines())

    def test_start_and_end_limit_what_moves(self, run, drive_mcap):
        limits = ("--start", "102", "--end", "104")
        stamps, _, _ = rows_of(run("lookup", drive_mcap, "map", "lidar", *limits)[1])
        assert (stamps[0], stamps[-1]) == (102 * S, 103_900_000_000)


def broken(path, tmp_path):
    """The same recording without its end."""
    whole = open(path, "rb").read()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 2])
    return str(cut)


class TestBroken:
    def test_it_is_one_line_and_status_1(self, drive_mcap, tmp_path):
        cut = broken(drive_mcap, tmp_path)
        for command in (["check", cut], ["lookup", cut, "map", "base"], ["plot", cut]):
            status, out, err = ended("tf2_bag", *command)
            assert (status, out, err.count("\n")) == (1, "", 1)
            assert err.startswith(f"tf2_bag {command[0]}: ") and cut in err
        assert not list(tmp_path.glob("*.png"))

    @pytest.mark.parametrize(
        ("name", "content"),
        [
            ("missing.mcap", None),
            ("empty.mcap", b""),
            ("zeros.mcap", bytes(5000)),
            ("empty.bag", b""),
            ("text.txt", b"hello"),
            ("zeros.db3", bytes(5000)),
        ],
    )
    def test_what_is_no_recording_is_told(self, tmp_path, name, content):
        if content is not None:
            (tmp_path / name).write_bytes(content)
        status, out, err = ended("tf2_bag", "info", str(tmp_path / name))
        assert (status, out, err.count("\n")) == (1, "", 1), err
        assert err.startswith("tf2_bag info: ") and name in err

    def test_one_without_transforms_shows_what_it_has(self, run, tmp_path, capsys):
        path = str(write_mcap(tmp_path / "scans.mcap", [scan(S, S)]))
        with pytest.raises(RunError, match="has no topic /tf or /tf_static"):
            run("info", path)
        assert "  /scan: sensor_msgs/msg/LaserScan, 1 message\n" in capsys.readouterr().out

    def test_one_without_a_message_has_nothing(self, run, tmp_path):
        path = write_mcap(tmp_path / "silent.mcap", [], topics=[("/tf", "tf2_msgs/msg/TFMessage")])
        assert run("check", path)[:2] == (
            1,
            "nothing: no transform was received\nwrong: 1 finding in 0 frames, 0 transforms and 0 s\n",
        )
        assert run("info", path)[0] == 0
        assert json.loads(run("info", path, "--json")[1])["begin"] is None
        with pytest.raises(RunError, match="has no transform"):
            run("plot", path)

    def test_one_that_may_not_be_read_is_named(self, run, drive_mcap, tmp_path):
        (tmp_path / "loop.mcap").symlink_to(tmp_path / "loop.mcap")
        with pytest.raises(RunError, match=r"loop\.mcap"):
            run("info", str(tmp_path / "loop.mcap"))


class TestInfo:
    def test_it_tells_what_was_put_in(self, run, drive_mcap):
        status, out, err = run("info", drive_mcap)
        assert (status, err) == (0, "")
        lines = out.splitlines()
        assert lines[0].startswith(f"{drive_mcap}: ") and lines[0].endswith(" kB")
        assert lines[1] == "100.000 to 110.000 s (10 s from 1970-01-01 00:01:40 UTC)"
        assert "  /scan: sensor_msgs/msg/LaserScan, 12 messages" in lines
        tree = [f"  {line}" for line in load(drive_mcap).tree().splitlines()]
        start = lines.index("tree:") + 1
        assert lines[start : start + len(tree)] == tree
        of_base = (
            "parent odom, publisher /tf, 10.0 Hz, delay 1.0 ms, max 1.0 ms, jitter 0.0 ms, longest gap 0.1 s"
        )
        assert f"  base: {of_base}" in lines
        assert "  camera: parent base, publisher /tf_static, static" in lines
        assert lines[-1] == "ok: no findings in 5 frames, 202 transforms and 10 s"

    def test_json_has_the_same(self, run, drive_mcap):
        said = json.loads(run("info", drive_mcap, "--json")[1])
        assert said["bytes"] == os.path.getsize(drive_mcap)
        assert [(topic["name"], topic["msgtype"], topic["count"]) for topic in said["topics"]] == [
            ("/scan", "sensor_msgs/msg/LaserScan", 12),
            ("/tf", "tf2_msgs/msg/TFMessage", 100),
            ("/tf_static", "tf2_msgs/msg/TFMessage", 2),
        ]
        assert (said["begin"], said["end"], said["transforms"]) == (100.0, 110.0, 202)
        frames = {stream["frame"]: stream for stream in said["streams"]}
        assert set(frames) == {"odom", "base", "camera", "lidar"}
        assert frames["odom"]["rate"] == pytest.approx(10.0)
        assert frames["odom"]["gap"] == pytest.approx(0.1)
        assert said["findings"] == []

    def test_other_formats_say_the_same(self, run, tmp_path):
        messages = drive(30)
        paths = [write_folder(tmp_path / "folder", messages), write_ros1(tmp_path / "old.bag", messages)]
        said = [json.loads(run("info", path, "--json")[1]) for path in paths]
        for one in said:
            del one["file"], one["bytes"], one["topics"]
        assert said[0] == said[1]


NAN = (math.nan, 0.0, 0.0)
FAULTS = [
    # Loop, second tree, two parents in turn, static and dynamic, future, gap, NaN, end.
    *(Sent(101 * S + i * S // 10, "/tf", [Tf("a", "b", 101 * S + i * S // 10)]) for i in range(80)),
    *(Sent(101 * S + i * S // 10, "/tf", [Tf("b", "a", 101 * S + i * S // 10)]) for i in range(80)),
    Sent(101 * S, "/tf_static", [Tf("sea", "boat", 0)]),
    *(
        Sent(101 * S + i * S // 10, "/tf", [Tf(("map", "odom")[i % 2], "twofold", 101 * S + i * S // 10)])
        for i in range(80)
    ),
    *(Sent(101 * S + i * S // 10, "/tf", [Tf("base", "camera", 101 * S + i * S // 10)]) for i in range(80)),
    *(Sent(101 * S + i * S // 10, "/tf", [Tf("base", "ahead", 102 * S + i * S // 10)]) for i in range(80)),
    *(
        Sent(101 * S + i * S // 10, "/tf", [Tf("base", "gappy", 101 * S + i * S // 10)])
        for i in range(80)
        if not 30 < i < 60
    ),
    *(
        Sent(101 * S + i * S // 10, "/tf", [Tf("base", "broken", 101 * S + i * S // 10, NAN)])
        for i in range(80)
    ),
    *(Sent(100 * S + i * S // 10, "/tf", [Tf("base", "gone", 100 * S + i * S // 10)]) for i in range(30)),
]
PLANTED = {
    ("loop", "a"),
    ("roots", ""),
    ("parents", "twofold"),
    ("mixed", "camera"),
    ("stale", "gone"),
    ("future", "ahead"),
    ("gap", "gappy"),
    ("refused", "broken"),
}


def findings(text):
    return {(one["kind"], one["frame"]) for one in json.loads(text)["findings"]}


class TestCheck:
    def test_finds_each_planted_fault(self, run, tmp_path):
        path = recording(tmp_path / "faults.mcap", *FAULTS)
        status, out, _ = run("check", path, "--json")
        assert (status, findings(out)) == (1, PLANTED)
        status, out, _ = run("check", path)
        *lines, verdict = out.splitlines()
        assert status == 1
        assert "parents: twofold has 2 parents in turn: map, odom" in lines
        assert "refused: 80 of 80 transforms of broken by /tf are refused: a number is NaN" in lines
        assert "stale: gone was last received 7 s before the end; its period is 0.1 s" in lines
        assert (
            verdict == f"wrong: {len(lines)} findings in 13 frames, {202 + len(FAULTS)} transforms and 10 s"
        )

    def test_a_healthy_recording_passes(self, run, drive_mcap, tmp_path):
        expected = tmp_path / "robot.yaml"
        expected.write_text(
            "frames:\n"
            "  base: {parent: odom, min_rate: 9, max_delay: 0.01, static: false}\n"
            "  camera: {parent: base, static: true}\n"
        )
        junit = tmp_path / "check.xml"
        status, out, err = run("check", drive_mcap, "--expect", expected, "--junit", junit, "--min-rate", 9)
        assert (status, out, err) == (0, "ok: no findings in 5 frames, 202 transforms and 10 s\n", "")
        suite = ElementTree.parse(junit).getroot()
        assert (suite.get("name"), suite.get("failures"), len(suite)) == ("tf2_bag", "0", len(KINDS))

    def test_what_is_expected_is_compared(self, run, drive_mcap, tmp_path):
        expected, junit = tmp_path / "robot.yaml", tmp_path / "check.xml"
        expected.write_text(
            "frames:\n"
            "  base: {parent: map, min_rate: 20, max_delay: 0.0005}\n"
            "  arm:\n"
            "  lidar: {static: false}\n"
        )
        arguments = ("check", drive_mcap, "--expect", expected, "--json", "--junit", junit)
        status, out, _ = run(*arguments, "--ignore", "delay")
        assert status == 1
        assert findings(out) == {
            ("parent", "base"),
            ("rate", "base"),
            ("missing", "arm"),
            ("static", "lidar"),
        }
        cases = {case.get("name"): [part.tag for part in case] for case in ElementTree.parse(junit).getroot()}
        assert cases["rate"] == ["failure"] and cases["delay"] == ["skipped"] and cases["loop"] == []
        assert ("delay", "base") in findings(run(*arguments)[1])

    def test_late_arrivals_while_the_recorder_discovers_are_no_delay(self, run, tmp_path):
        late = [
            Sent(100 * S + 100_000 + i, "/tf", [Tf("odom", "base", 97 * S + i * S // 10)]) for i in range(20)
        ]
        path = recording(tmp_path / "late.mcap", *late)
        (tmp_path / "robot.yaml").write_text("frames:\n  base: {max_delay: 0.5}\n")
        status, out, _ = run("check", path, "--expect", tmp_path / "robot.yaml")
        assert (status, out.count("\n")) == (0, 1), out

    def test_what_ends_while_the_robot_shuts_down_is_not_missing(self, run, tmp_path):
        ends = [
            Sent(100 * S + i * S // 10, "/tf", [Tf("base", "arm", 100 * S + i * S // 10)]) for i in range(60)
        ]
        path = recording(tmp_path / "ends.mcap", *ends)
        assert run("check", path, "--min-rate", 9)[0] == 0

    def test_a_recorder_that_stays_on_is_told_once(self, run, tmp_path):
        path = recording(tmp_path / "on.mcap", scan(140 * S, 140 * S))
        status, out, _ = run("check", path)
        assert (status, out.splitlines()[0]) == (
            1,
            "stale: no dynamic transform was received in the last 30.1 s",
        )
        assert out.count("\n") == 2
        # What comes later than the end that was asked for is not missing.
        assert run("check", path, "--end", 112)[0] == 0

    def test_a_frame_has_the_rate_of_its_own_time(self, run, tmp_path):
        early = [
            Sent(100 * S + i * S // 10, "/tf", [Tf("base", "arm", 100 * S + i * S // 10)]) for i in range(30)
        ]
        path = recording(tmp_path / "early.mcap", *early)
        assert findings(run("check", path, "--json", "--min-rate", 9)[1]) == {("stale", "arm")}

    def test_stamps_of_another_clock_have_no_delay(self, run, tmp_path):
        wall = 1_700_000_000 * S
        messages = [one._replace(log_ns=one.log_ns + wall) for one in drive(100)]
        path = str(write_mcap(tmp_path / "sim.mcap", messages))
        status, out, _ = run("check", path)
        assert (status, out) == (0, "ok: no findings in 5 frames, 202 transforms and 10 s\n")
        out = run("info", path)[1]
        assert "stamps and log times are of different clocks: no delays\n" in out
        assert "  base: parent odom, publisher /tf, 10.0 Hz, longest gap 0.1 s\n" in out
        # And the other way round, where all stamps are ahead.
        ahead = [
            one._replace(content=[tf._replace(ns=tf.ns + wall) for tf in one.content]) for one in drive(100)
        ]
        assert run("check", str(write_mcap(tmp_path / "ahead.mcap", ahead)))[0] == 0

    def test_of_a_saved_buffer_no_delay_is_known(self, run, tmp_path, tf2_ros):
        buffer = tf2_ros.Buffer()
        for i in range(100):
            stamp = 1_795_000_000 + i / 20
            buffer.set_transform(transform("map", "odom", stamp), "here")
            buffer.set_transform(transform("odom", "base", stamp - 6), "a publisher that is late")
        buffer.save(tmp_path / "saved.mcap")
        status, out, _ = run("check", tmp_path / "saved.mcap", "--max-delay", "0")
        assert (status, out[:27]) == (0, "ok: no findings in 3 frames")
        _, out, _ = run("info", tmp_path / "saved.mcap")
        assert "  base: parent odom, publisher /tf, 20.0 Hz, longest gap 0.05 s\n" in out
        assert "\nsaved by a buffer, which keeps stamps but no times of reception: no delays\n" in out
        _, out, _ = run("info", tmp_path / "saved.mcap", "--json")
        found = json.loads(out)
        assert found["saved"] and {one["delay"] for one in found["streams"]} == {None}

    def test_a_late_clock_is_found(self, run, tmp_path):
        moving = [
            Sent(105 * S + i * S // 20, "/tf", [Tf("map", "odom", 100 * S + i * S // 20)]) for i in range(60)
        ]
        path = str(write_mcap(tmp_path / "late.mcap", moving))
        status, out, _ = run("check", path)
        assert (status, out.splitlines()[0]) == (
            1,
            "delay: odom is on average 5 s old when it is received, more than 1 s",
        )
        assert run("check", path, "--max-delay", "6")[0] == 0

    def test_an_unknown_kind_and_expectations_are_wrong_usage(self, run, drive_mcap, tmp_path):
        with pytest.raises(UsageError, match="--ignore: nonsense is not one of nothing, clock, clocks"):
            run("check", drive_mcap, "--ignore", "nonsense")
        (tmp_path / "bad.yaml").write_text("frames: 3\n")
        with pytest.raises(UsageError, match=r"bad\.yaml: frames must be"):
            run("check", drive_mcap, "--expect", tmp_path / "bad.yaml")

    def test_expectations_without_a_reader_of_yaml_say_what_to_install(self, run, drive_mcap, monkeypatch):
        monkeypatch.setitem(sys.modules, "yaml", None)
        advice = re.escape("PyYAML: pip install 'tf2-ros-cython[cli]'")
        with pytest.raises(RunError, match=f"--expect needs the Python package {advice}"):
            run("check", drive_mcap, "--expect", "robot.yaml")

    def test_names_are_shown_escaped(self, run, tmp_path):
        path = recording(tmp_path / "a.mcap", Sent(100 * S, "/tf_static", [Tf("se\na", "x\x1b[2J", 0)]))
        for command in ("check", "info"):
            out = run(command, path)[1]
            assert "\x1b" not in out and r"se\na" in out


class TestPictures:
    def test_the_tree_is_text_without_a_file(self, run, drive_mcap):
        assert run("tree", drive_mcap) == (0, f"{load(drive_mcap).tree()}\n", "")

    @needs_dot
    def test_the_tree_is_drawn(self, run, drive_mcap, tmp_path):
        for kind in ("svg", "pdf", "png"):
            assert run("tree", drive_mcap, "-o", tmp_path / f"t.{kind}")[1] == f"{tmp_path}/t.{kind}\n"
        texts = texts_of(tmp_path / "t.svg")
        assert {"map", "odom", "base", "camera", "/tf_static", "10.0 Hz", "buffer 9.90 s"} <= set(texts)
        assert (tmp_path / "t.pdf").read_bytes().startswith(b"%PDF")
        assert (tmp_path / "t.png").read_bytes().startswith(b"\x89PNG")
        assert sorted(os.listdir(tmp_path)) == ["t.pdf", "t.png", "t.svg"]

    def test_without_the_package_graphviz_one_line_says_what_to_install(
        self, run, drive_mcap, tmp_path, monkeypatch
    ):
        monkeypatch.setattr("tf2_ros_tools.pictures.find_spec", lambda name: None)
        advice = re.escape("graphviz: pip install 'tf2-ros-cython[cli]'; the tree as text does not")
        with pytest.raises(RunError, match=f"pictures need the Python package {advice}"):
            run("tree", drive_mcap, "-o", tmp_path / "t.svg")

    def test_graphvizs_file_needs_no_graphviz(self, run, drive_mcap, tmp_path, monkeypatch):
        monkeypatch.setenv("PATH", str(tmp_path))
        assert run("tree", drive_mcap, "-o", tmp_path / "t.gv")[0] == 0
        assert "digraph" in (tmp_path / "t.gv").read_text()
        with pytest.raises(RunError, match=r"install Graphviz.*a file that ends in \.gv does not need it"):
            run("tree", drive_mcap, "-o", tmp_path / "t.svg")

    def test_all_frames_have_a_row(self, run, drive_mcap, tmp_path):
        run("plot", drive_mcap, "-o", tmp_path / "p.svg")
        texts = texts_of(tmp_path / "p.svg")
        assert [text for text in texts if text in ("odom", "base", "camera", "lidar")] == [
            "odom",
            "lidar",
            "camera",
            "base",
        ]
        assert {"time in s", "100", "110"} <= set(texts)
        run("plot", drive_mcap, "base", "nobody", "-o", tmp_path / "q.svg")
        assert {"base", "nobody", "not received"} <= set(texts_of(tmp_path / "q.svg"))

    def test_a_picture_of_one_message_and_of_a_part_is_drawn(self, run, drive_mcap, tmp_path):
        mount = Sent(100 * S, "/tf_static", [Tf("base", "camera", 100 * S)])
        path = write_mcap(tmp_path / "mount.mcap", [mount])
        assert run("plot", path, "-o", tmp_path / "p.svg")[0] == 0
        assert "static, /tf_static" in texts_of(tmp_path / "p.svg")
        assert run("plot", drive_mcap, "--start", 104, "--end", 106, "-o", tmp_path / "q.svg")[0] == 0
        ticks = [float(text) for text in texts_of(tmp_path / "q.svg") if re.fullmatch(r"[\d.]+", text)]
        assert ticks and all(104.0 <= tick <= 106.0 for tick in ticks)

    def test_a_way_is_drawn(self, run, drive_mcap, tmp_path):
        run("plot", drive_mcap, "--path", "map", "camera", "-o", tmp_path / "w.svg")
        assert {"camera in map", "from above", "roll"} <= set(texts_of(tmp_path / "w.svg"))

    @pytest.mark.parametrize(
        ("arguments", "said"),
        [
            (["--path", "map", "nobody"], "nobody is not known"),
            (["camara", "/no_one"], r"camara is not known; did you mean camera\?; no_one is not known"),
            (["--path", "base", "camera"], "nothing moves between base and camera"),
        ],
    )
    def test_where_there_is_nothing_to_draw_it_says_why(self, run, drive_mcap, tmp_path, arguments, said):
        with pytest.raises(RunError, match=f"^{said}$"):
            run("plot", drive_mcap, *arguments, "-o", tmp_path / "x.svg")
        assert not (tmp_path / "x.svg").exists()

    def test_a_gap_on_a_path_is_marked(self, run, drive_mcap, tmp_path):
        messages = [one for one in drive(100) if not 103 * S < one.log_ns < 105 * S]
        path = write_mcap(tmp_path / "gap.mcap", messages)
        for name, gaps in ((path, 1), (drive_mcap, 0)):
            run("plot", name, "--path", "map", "camera", "-o", tmp_path / "g.svg")
            assert texts_of(tmp_path / "g.svg").count("gap") == gaps
            run("plot", name, "--path", "map", "camera", "-o", tmp_path / "g.pdf")
            assert (tmp_path / "g.pdf").read_bytes().startswith(b"%PDF-")

    def test_without_a_name_the_picture_has_that_of_the_recording(
        self, run, drive_mcap, tmp_path, monkeypatch
    ):
        monkeypatch.chdir(tmp_path)
        assert run("plot", drive_mcap)[1] == "drive.png\n"
        assert os.listdir(tmp_path) == ["drive.png"]

    def test_frames_and_a_way_are_not_both(self, run, drive_mcap):
        with pytest.raises(UsageError, match="frames or --path, not both"):
            run("plot", drive_mcap, "base", "--path", "map", "base")


class TestBatch:
    @pytest.fixture(autouse=True)
    def libraries(self):
        for name in ("pyarrow", "distributed"):
            pytest.importorskip(name)

    def test_each_recording_gets_a_table_and_a_spoiled_one_is_told(self, run, tmp_path):
        parquet = pytest.importorskip("pyarrow.parquet")

        (tmp_path / "day").mkdir()
        paths = [recording(tmp_path / "day" / f"{i}.mcap", count=30) for i in range(3)]
        (tmp_path / "day" / "bad.mcap").write_bytes(bytes(100))
        command = ("batch", tmp_path / "day", "--lookup", "map", "camera", "--rate", 5, "--workers", 1)
        status, out, err = run(*command, "--out", tmp_path / "tables")
        counts, findings = out.splitlines()
        assert (status, counts) == (1, "3 done, 0 done before, 1 failed")
        assert err.startswith("tf2_bag batch: ") and "bad.mcap" in err and err.count("\n") == 1
        assert os.path.dirname(findings) == str(tmp_path / "tables")
        tables = [parquet.read_table(one).to_pydict() for one in (tmp_path / "tables").glob("[!_]*.parquet")]
        assert sorted(table["file"][0] for table in tables) == paths
        stamps, poses, _ = rows_of(run("lookup", paths[0], "map", "camera", "--rate", 5)[1])
        for table in tables:
            assert table["stamp"] == stamps
            assert np.array_equal(np.array([table[name] for name in COLUMNS]).T, poses)
        (tmp_path / "day" / "bad.mcap").unlink()
        assert run(*command, "--out", tmp_path / "tables")[1].startswith("0 done, 3 done before, 0 failed\n")

    def test_a_misspelt_frame_is_told_and_no_success(self, run, tmp_path):
        path = recording(tmp_path / "a.mcap", count=30)
        command = ("batch", path, "--lookup", "map", "camra", "--out", tmp_path / "tables", "--workers", 1)
        for counts in ("1 done, 0 done before", "0 done, 1 done before"):
            status, out, err = run(*command)
            assert (status, out.splitlines()[0]) == (1, f"{counts}, 0 failed, 1 without an answer")
            assert err.startswith(f"tf2_bag batch: {path}: ") and "camra" in err and err.count("\n") == 1

    def test_a_folder_that_cannot_be_read_is_told(self, run, tmp_path, monkeypatch):
        (tmp_path / "day" / "closed").mkdir(parents=True)
        recording(tmp_path / "day" / "a.mcap", count=30)
        scandir = os.scandir

        def refuse(path="."):
            if "closed" in os.fspath(path):
                raise PermissionError(13, "Permission denied", os.fspath(path))
            return scandir(path)

        monkeypatch.setattr(os, "scandir", refuse)
        command = ("--lookup", "map", "camera", "--out", tmp_path / "tables", "--workers", 1)
        status, out, err = run("batch", tmp_path / "day", *command)
        assert (status, out.splitlines()[0]) == (1, "1 done, 0 done before, 1 failed")
        assert err == f"tf2_bag batch: {tmp_path}/day/closed: Permission denied\n"

    def test_ctrl_c_says_how_to_go_on(self, tmp_path):
        one = recording(tmp_path / "0.mcap", count=30)
        for i in range(1, 2000):  # far more than are done before the signal
            os.link(one, tmp_path / f"{i}.mcap")
        tables = tmp_path / "tables"
        command = ("batch", str(tmp_path), "--lookup", "map", "camera", "--workers", "1")
        with running("tf2_bag", *command, "--out", tables) as process:
            until(lambda: next(tables.glob("[!_]*.parquet"), None))
            process.send_signal(signal.SIGINT)
            _, err = process.communicate(timeout=DEADLINE_S)
        assert process.returncode == 128 + signal.SIGINT
        assert err == "tf2_bag batch: interrupted; the same command does the rest\n"

    @pytest.mark.parametrize(
        ("arguments", "said"),
        [
            (["nothing/*.mcap", "--lookup", "a", "b", "--out", "o"], "nothing"),
            (["README.md", "--lookup", "//a", "b", "--out", "o"], "cannot start with a '/'"),
            (["README.md", "--lookup", "a", "b", "--out", "/proc/nothing"], "/proc/nothing"),
        ],
    )
    def test_what_cannot_begin_is_told(self, tmp_path, arguments, said):
        (tmp_path / "README.md").write_text("run.mcap\n")
        status, out, err = ended("tf2_bag", "batch", *arguments, cwd=tmp_path)
        assert (status, out, err.count("\n")) == (1, "", 1), err
        assert err.startswith("tf2_bag batch: ") and said in err


class TestView:
    def test_it_can_be_written(self, run, drive_mcap, tmp_path):
        pytest.importorskip("rerun")
        assert run("view", drive_mcap, "-o", tmp_path / "a.rrd") == (0, f"{tmp_path / 'a.rrd'}\n", "")
        assert (tmp_path / "a.rrd").read_bytes().startswith(b"RRF2")
        with pytest.raises(RunError, match="cannot write /nothing/a.rrd: No such file"):
            run("view", drive_mcap, "-o", "/nothing/a.rrd")

    def test_without_a_screen_it_says_so_in_one_line(self, drive_mcap):
        pytest.importorskip("rerun")
        screens = {"DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"}
        bare = {name: value for name, value in os.environ.items() if name not in screens}
        status, out, err = ended("tf2_bag", "view", drive_mcap, env=bare)
        assert (status, out, err.count("\n")) == (1, "", 1), err
        assert err.startswith("tf2_bag view: the viewer of rerun did not open: there is no screen (neither ")
        assert err.endswith(" is set); -o FILE does not need a screen\n")


def texts_of(path):
    root = ElementTree.parse(path).getroot()
    return ["".join(text.itertext()) for text in root.iter(f"{SVG}text")]


class TestManners:
    @pytest.mark.parametrize("command", COMMANDS)
    def test_each_command_has_a_help_with_an_example_of_itself(self, command, capsys):
        with pytest.raises(SystemExit) as ending:
            parser().read(["tf2_bag", command, "--help"])
        out, err = capsys.readouterr()
        assert (ending.value.code, err) == (0, "")
        assert out.startswith(f"usage: tf2_bag {command} ")
        assert "Exit status: " in out and f"\nexample:\n  tf2_bag {command} " in out
        assert max(map(len, out.splitlines())) <= 110

    @pytest.mark.parametrize(
        ("line", "answer"),
        [("tf2_bag loo", "lookup"), ("tf2_bag lookup a.mcap map base --parq", "--parquet")],
    )
    def test_a_shell_gets_commands_and_their_options(self, tmp_path, line, answer):
        assert completed(line, tmp_path) == answer

    def test_a_library_that_is_missing_is_named_with_its_extra(self, drive_mcap):
        code = (
            "import sys; sys.modules['rosbags'] = None\n"
            "from tf2_ros_tools.programs.tf2_bag import main; sys.exit(main())"
        )
        done = subprocess.run(
            [sys.executable, "-c", code, "info", drive_mcap],
            text=True,
            capture_output=True,
            timeout=DEADLINE_S,
        )
        assert (done.returncode, done.stdout) == (1, "")
        assert done.stderr == "tf2_bag info: rosbags is not installed: pip install 'tf2-ros-cython[bag]'\n"


WITHOUT_ROS = """
import sys
names = "rclpy geometry_msgs std_msgs sensor_msgs builtin_interfaces rcl_interfaces action_msgs rpyutils"
sys.modules.update(dict.fromkeys(names.split()))
from tf2_ros_tools.programs.tf2_bag import main
sys.exit(main())
"""


class TestWithoutRos:
    @pytest.mark.parametrize(
        "arguments",
        [
            ["info"],
            ["check", "--json"],
            ["lookup", "map", "camera", "--at", "/scan"],
            ["tree"],
            ["plot", "--path", "map", "camera", "-o", "way.svg"],
        ],
        ids=lambda arguments: arguments[0],
    )
    def test_it_prints_the_same(self, run, drive_mcap, tmp_path, monkeypatch, arguments):
        monkeypatch.chdir(tmp_path)
        command = [arguments[0], drive_mcap, *arguments[1:]]
        done = subprocess.run(
            [sys.executable, "-c", WITHOUT_ROS, *command], text=True, capture_output=True, timeout=DEADLINE_S
        )
        assert (done.returncode, done.stdout, done.stderr) == run(*command)
