# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""tf2_bag: its commands on recordings that the tests make, in this process, and a few in one of their own."""

import csv
import io
import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from making_bags import (
    ODOMETRY,
    SCAN,
    STAMPED,
    STAMPS,
    TRANSFORM,
    S,
    Sent,
    Tf,
    drive,
    header,
    scan,
    series,
    write_db3,
    write_mcap,
    write_ros1,
)
from pickles_and_copies import held
from picture_texts import texts_of
from robot_of_all_joints import ARM, description, joint_state
from starting_programs import needs_dot

from tf2_ros import Buffer
from tf2_ros_tools.bag import load, save
from tf2_ros_tools.common.optional_libraries import MissingLibraryError
from tf2_ros_tools.common.program import RunError, UsageError
from tf2_ros_tools.programs.tf2_bag import PARSER, bag

SCANS = [100 * S + i * S // 4 + 7 for i in range(12)]
HOPS = (("map", "odom"), ("odom", "base"))
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
        status = bag(PARSER.read(["tf2_bag", *map(str, arguments)]))
        return status, *capsys.readouterr()

    return run


def rows_of(text):
    rows = list(csv.DictReader(io.StringIO(text)))
    stamps = [int(row["stamp_ns"]) for row in rows]
    return stamps, [[float(row[name]) for name in COLUMNS] for row in rows], [row["valid"] for row in rows]


@pytest.mark.long("needs pyarrow")
def test_all_formats_of_a_lookup_hold_the_same(run, drive_mcap, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")

    ends = ("map", "camera", "--times", "1", "100.123456789", "105")
    stamps, poses, valid = rows_of(run("lookup", drive_mcap, *ends)[1])
    for name in ("a.csv", "a.tum", "a.parquet"):
        assert run("lookup", drive_mcap, *ends, "-o", tmp_path / name)[:2] == (0, f"{tmp_path / name}\n")
    of_csv = rows_of((tmp_path / "a.csv").read_text())
    assert (of_csv[0], of_csv[2]) == (stamps, valid)
    assert np.array_equal(of_csv[1], poses, equal_nan=True)
    lines = (tmp_path / "a.tum").read_text().splitlines()
    assert [line.split()[0] for line in lines] == ["100.123456789", "105.000000000"]
    assert [[*map(float, line.split()[1:])] for line in lines] == poses[1:]
    table = parquet.read_table(tmp_path / "a.parquet").to_pydict()
    assert list(table) == ["file", "stamp_ns", *COLUMNS, "valid", "gap"]
    assert (table["file"], table["stamp_ns"]) == ([drive_mcap] * 3, stamps)
    assert table["valid"] == [False, True, True]
    assert np.array_equal(np.array([table[name] for name in COLUMNS]).T, poses, equal_nan=True)
    assert sorted(os.listdir(tmp_path)) == ["a.csv", "a.parquet", "a.tum"]


@pytest.mark.parametrize(
    ("option", "one", "other"),
    [
        ("--topic", "/tf=r/", "/tf=s/"),
        ("--poses", "/odom", "/odom=map,base"),
        ("--urdf", "robot.urdf", "/joint_states=recorded"),
    ],
)
def test_a_topic_given_twice_is_wrong_usage(run, drive_mcap, option, one, other):
    topic = {"--topic": "/tf", "--poses": "/odom", "--urdf": "/joint_states"}[option]
    with pytest.raises(UsageError, match=f"^{option}: expected each topic once, got {topic} twice$"):
        run("check", drive_mcap, option, one, option, other)


def test_explain_shows_the_samples_of_each_hop(run, drive_mcap):
    status, out, err = run("explain", drive_mcap, "map", "camera", "--at", "104.25")
    assert (status, err) == (0, "")
    wanted = str(load(drive_mcap).explain("map", "camera", 104_250_000_000))
    assert out == f"{wanted}\n"
    assert "interpolated 50 % between" in out
    assert "last from /tf_static" in out
    latest = load(drive_mcap).explain("map", "camera", 0)
    assert run("explain", drive_mcap, "map", "camera")[:2] == (0, f"{latest}\n")


def test_explain_names_the_publishers_of_the_samples(run, tmp_path):
    sent = [Sent(ns, "/tf", [Tf("map", "odom", ns)]) for ns in (S, 3 * S)]
    sent += [Sent(2 * S, "/gps/tf", [Tf("map", "odom", 2 * S)])]
    sent += [Sent(S, topic, [Tf("odom", "base", S)]) for topic in ("/tf_static", "/a/tf_static")]
    sent.sort(key=lambda one: one.log_ns)
    path = write_mcap(tmp_path / "two.mcap", sent)
    topics = [f"--topic={topic}" for topic in ("/tf", "/gps/tf", "/tf_static", "/a/tf_static")]
    _, out, _ = run("explain", path, "map", "base", "--at", "2.5", *topics)
    assert out.splitlines()[-2:] == [
        "base has 2 publishers, /a/tf_static, /tf_static; these samples are from /a/tf_static",
        "odom has 2 publishers, /gps/tf, /tf; these samples are from /gps/tf, /tf",
    ]
    _, out, _ = run("explain", path, "map", "odom", "--at", "2", *topics)
    assert out.splitlines()[-1].endswith("these samples are from /gps/tf")


def test_explain_fails_as_the_lookup_does(run, drive_mcap):
    with pytest.raises(RunError, match=r"camra.* does not exist\. Did you mean \[camera\]\?"):
        run("explain", drive_mcap, "map", "camra")
    with pytest.raises(RunError, match="extrapolation into the past"):
        run("explain", drive_mcap, "map", "camera", "--at", "1")
    with pytest.raises(SystemExit, match="2"):
        run("explain", drive_mcap, "map", "camera", "--at", "0")


class TestTrajectory:
    """A trajectory whose poses are one meter above those of the recording; the first one is too early."""

    @pytest.fixture
    def tum(self, run, drive_mcap, tmp_path):
        run("lookup", drive_mcap, "map", "base", "--times", *range(100, 110), "-o", tmp_path / "own.tum")
        lines = [line.split() for line in (tmp_path / "own.tum").read_text().splitlines()]
        raised = [f"{stamp} {x} {y} 1.0 {' '.join(turn)}" for stamp, x, y, _, *turn in lines]
        (tmp_path / "raised.tum").write_text("\n".join(["99.0 0 0 0 0 0 0 1", *raised]))
        return str(tmp_path / "raised.tum")

    def test_a_lookup_is_corrected_by_it(self, run, drive_mcap, tum):
        ends = ("map", "camera", "--rate", "4")
        status, out, err = run("lookup", drive_mcap, *ends, "--trajectory", tum, "/map", "odom", "base")
        assert (status, err.count("\n")) == (0, 1)
        assert f"1 of the 11 poses in {tum} is left out, because base in odom is not known then" in err
        stamps, poses, _ = rows_of(out)
        wanted = rows_of(run("lookup", drive_mcap, *ends)[1])
        assert stamps == wanted[0]
        difference = np.array(poses) - wanted[1]
        np.testing.assert_allclose(difference[:, 2], 1.0, rtol=0, atol=1e-9)
        before_the_last = np.array(stamps) <= 109 * S
        assert abs(difference[before_the_last, :2]).max() < 1e-3

    def test_it_may_put_a_new_frame_above_the_others(self, run, drive_mcap, tum, tmp_path):
        world = ("--trajectory", tum, "world", "map", "base")
        stamps, poses, _ = rows_of(run("lookup", drive_mcap, "world", "base", *world)[1])
        assert len(stamps) == 100
        np.testing.assert_allclose(np.array(poses)[:, 2], 1.0, rtol=0, atol=1e-9)
        out = run("explain", drive_mcap, "world", "camera", "--at", "104.5", *world)[1]
        assert "world ← map  interpolated 50 % between 104.000 and 105.000 s (gap 1.000 s), last from" in out
        pytest.importorskip("matplotlib")
        written = str(tmp_path / "path.svg")
        assert run("plot", drive_mcap, "--path", "world", "base", *world, "-o", written)[0] == 0

    def test_rewrite_writes_a_recording_that_says_the_same(self, run, drive_mcap, tum, tmp_path):
        own, written = ("--trajectory", tum, "map", "odom", "base"), str(tmp_path / "corrected.mcap")
        status, out, err = run("rewrite", drive_mcap, *own, "-o", written)
        assert (status, out, err.count("left out")) == (0, f"{written}\n", 1)
        for frame in ("base", "camera", "lidar"):
            ends = ("map", frame, "--rate", "50")
            corrected = run("lookup", drive_mcap, *ends, *own)[1]
            stamps, poses, _ = rows_of(run("lookup", written, *ends)[1])
            assert stamps == rows_of(corrected)[0]
            np.testing.assert_allclose(poses, rows_of(corrected)[1], rtol=0, atol=1e-12)
        assert load(written).frames()["camera"].static
        frozen = str(tmp_path / "corrected.tf2")
        assert run("freeze", drive_mcap, *own, "-o", frozen)[0] == 0
        assert {"odom", "base", "camera", "lidar"} == {*Buffer.open(frozen).histories()}
        # A player sends a transform at its stamp: the robot is known in the map whenever it was measured.
        histories = load(written).histories()
        assert histories["odom"].stamps_ns.tolist() == histories["base"].stamps_ns.tolist()
        assert len(Buffer.open(frozen).histories()["odom"].stamps_ns) < 20

    @pytest.mark.parametrize("later", ["dated ahead", "another parent"])
    def test_rewrite_needs_no_odometry_at_the_last_stamp(self, run, tmp_path, later):
        """A localizer dates its transforms ahead; or the robot is carried away at the end."""
        stamps = [100 * S + i * S // 10 for i in range(100)]
        ahead = S if later == "dated ahead" else 0
        moving = [[Tf("odom", "base", ns, (ns / S, 0, 0)), Tf("map", "odom", ns + ahead)] for ns in stamps]
        sent = [Sent(own[0].ns, "/tf", own) for own in moving]
        if later == "another parent":
            sent.append(Sent(111 * S, "/tf", [Tf("dock", "base", 111 * S)]))
        path, written = write_mcap(tmp_path / "run.mcap", sent), tmp_path / "corrected.mcap"
        (tmp_path / "two.tum").write_text("101 1 5 0 0 0 0 1\n109 9 5 0 0 0 0 1\n")
        own = ("--trajectory", tmp_path / "two.tum", "map", "odom", "base")
        assert run("rewrite", path, *own, "-o", written)[0] == 0
        buffer = load(written)
        inside = [ns for ns in stamps if 101 * S <= ns <= 109 * S]
        assert set(inside) <= {*buffer.histories()["odom"].stamps_ns.tolist()}
        places = buffer.lookup_transforms("map", "base", inside)[0]
        np.testing.assert_allclose(places, [(ns / S - 100, 5, 0) for ns in inside], rtol=0, atol=1e-9)

    def test_the_time_between_keyframes_is_not_a_gap_of_a_lookup(self, run, tmp_path):
        keyframes, missing = "100 0 0 0 0 0 0 1\n109.9 9 0 0 0 0 0 1\n", (103 * S, 105 * S)
        (tmp_path / "two.tum").write_text(keyframes)
        sent = [one for one in drive(100) if not missing[0] < one.log_ns < missing[1]]
        path = write_mcap(tmp_path / "gap.mcap", sent)
        own = ("--trajectory", tmp_path / "two.tum", "map", "odom", "base")
        looked_up = ("lookup", path, "map", "base", *own, "--times", "102.05", "104")
        gaps = [float(row["gap"]) for row in csv.DictReader(io.StringIO(run(*looked_up)[1]))]
        assert gaps == pytest.approx([0.1, 2.1])
        status, out, err = run(*looked_up, "--max-gap", "0.5")
        assert (status, rows_of(out)[2]) == (0, ["true", "false"])
        assert "no answer at 1 of 2 times" in err
        with pytest.raises(RunError, match="all poses are interpolated across gaps of more than 0.05 s"):
            run(*looked_up, "--max-gap", "0.05")

    def test_explain_names_no_publishers_of_corrected_samples(self, run, tmp_path):
        sent = [Sent(i * S, "/tf", [Tf("map", "odom", i * S), Tf("odom", "base", i * S)]) for i in (1, 2, 3)]
        sent += [Sent(ns, "/gps/tf", [Tf(*ends, ns)]) for ns in (3 * S // 2, 5 * S // 2) for ends in HOPS]
        path = write_mcap(tmp_path / "two.mcap", sorted(sent, key=lambda one: one.log_ns))
        (tmp_path / "own.tum").write_text("1 0 0 0 0 0 0 1\n2 1 0 0 0 0 0 1\n")
        how = ("--topic=/tf", "--topic=/gps/tf", "--trajectory", tmp_path / "own.tum", "map", "odom", "base")
        for at in ("1.75", "2.75"):
            out = run("explain", path, "map", "base", "--at", at, *how)[1]
            assert "last from tf2_ros.correction" in out
            named = [line for line in out.splitlines() if "these samples are from" in line]
            assert named == ["base has 2 publishers, /gps/tf, /tf; these samples are from /gps/tf, /tf"]

    def test_stamps_of_kitti_are_in_another_file(self, run, drive_mcap, tmp_path):
        (tmp_path / "poses.txt").write_text("1 0 0 7 0 1 0 8 0 0 1 9\n" * 2)
        (tmp_path / "times.txt").write_text("101\n102\n")
        files = ("--trajectory", tmp_path / "poses.txt", "map", "odom", "base")
        times = ("--times", "101", "102")
        with pytest.raises(RunError, match="line 1: expected 8 numbers.*need `times` or --trajectory-times"):
            run("lookup", drive_mcap, "map", "base", *times, *files)
        more = ("--trajectory-times", tmp_path / "times.txt")
        out = run("lookup", drive_mcap, "map", "base", *times, *files, *more)[1]
        assert rows_of(out)[1] == [pytest.approx([7, 8, 9, 0, 0, 0, 1], abs=1e-9)] * 2
        (tmp_path / "times.txt").write_text("0.00e+00\n1.00e+00\n")  # as in KITTI's own
        relative = (*files, *more, "--trajectory-start")
        with pytest.raises(
            RunError, match="if they count from a start, pass it as `start` or --trajectory-start"
        ):
            run("lookup", drive_mcap, "map", "base", *times, *relative[:-1])
        for start in ("101", "recording"):
            out = run("lookup", drive_mcap, "map", "base", "--times", "101", *relative, start)[1]
            assert rows_of(out)[1] == [pytest.approx([7, 8, 9, 0, 0, 0, 1], abs=1e-9)]

    def test_the_tables_of_a_lookup_are_read_back(self, run, drive_mcap, tmp_path):
        ends = (drive_mcap, "map", "base", "--times", "99", *map(str, range(101, 105)))
        wanted = rows_of(run("lookup", *ends)[1])
        for name in ("own.csv", "own.tum"):
            run("lookup", *ends, "-o", tmp_path / name)
            own = ("--trajectory", tmp_path / name, "map", "odom", "base")
            out, err = run("lookup", *ends, *own)[1:]
            assert "left out" not in err
            assert rows_of(out)[0] == wanted[0]
            np.testing.assert_allclose(rows_of(out)[1], wanted[1], rtol=0, atol=1e-12)

    def test_what_does_not_fit_is_refused(self, run, drive_mcap, tum):
        own = ("--trajectory", tum, "map", "odom", "base")
        with pytest.raises(UsageError, match="--trajectory-times needs --trajectory"):
            run("lookup", drive_mcap, "map", "base", "--trajectory-times", tum)
        with pytest.raises(UsageError, match="--trajectory-start needs --trajectory"):
            run("lookup", drive_mcap, "map", "base", "--trajectory-start", "recording")
        with pytest.raises(UsageError, match="--trajectory-columns needs --trajectory"):
            run("lookup", drive_mcap, "map", "base", "--trajectory-columns", "t x y z qx qy qz qw")
        with pytest.raises(SystemExit):
            run("lookup", drive_mcap, "map", "base", *own, "--trajectory-columns", "t x y z qx qy qz")
        names = ("--trajectory-columns", "t x y z qx qy qz qw -")
        with pytest.raises(RunError, match="expected 9 columns, got 8: "):
            run("lookup", drive_mcap, "map", "base", "--times", "101", *own, *names)
        with pytest.raises(UsageError, match="--trajectory needs --path"):
            run("plot", drive_mcap, *own)
        with pytest.raises(RunError, match=r'"robot" .* does not exist'):
            run("lookup", drive_mcap, "map", "base", *own[:-1], "robot")
        with pytest.raises(
            FileNotFoundError, match="neither a file nor a topic of .* are: none: '/slam/path'"
        ):
            run("explain", drive_mcap, "map", "base", "--trajectory", "/slam/path", *own[2:])


class TestOtherTopics:
    """What the programs computes from messages that are not TFMessages."""

    @pytest.mark.parametrize(
        ("options", "parent", "child"),
        [
            (["--poses", "/odom"], "map", "base"),
            (["--poses", "/vicon/robot"], "map", "base"),
            (["--poses", "/odom=world,robot"], "world", "robot"),
            (["--poses", "/gps=/map,/gps"], "map", "gps"),
            (["--poses", "/odom", "--poses", "/gps=map,gps"], "base", "gps"),
        ],
    )
    def test_poses_are_looked_up(self, run, options, parent, child, tmp_path):
        messages = [*series("/odom", ODOMETRY), *series("/gps", STAMPED), *series("/vicon/robot", TRANSFORM)]
        path = write_mcap(tmp_path / "run.mcap", messages)
        stamps, poses, valid = rows_of(run("lookup", path, parent, child, *options)[1])
        assert (stamps, set(valid)) == (STAMPS, {"true"})
        moved = [[0.0] * 3 if parent == "base" else [i / 10, 2.0, 3.0] for i in range(20)]
        np.testing.assert_allclose([pose[:3] for pose in poses], moved, atol=1e-15)
        assert f"{child}: parent " in run("info", path, *options)[1]

    @pytest.mark.parametrize(
        "options",
        [
            ["arm.urdf"],
            ["recorded"],
            ["/joint_states=arm.urdf"],
            ["/left/joint_states=arm.urdf"],
            ["/left/joint_states=recorded"],
        ],
    )
    def test_joint_states_are_looked_up(self, run, options, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "arm.urdf").write_text(ARM)
        left = "/left" if "left" in options[0] else ""
        states = [joint_state(ns, ["extend"], [0.1], topic=f"{left}/joint_states") for ns in STAMPS]
        write_mcap("run.mcap", [description(topic=f"{left}/robot_description"), *states])
        status, out, _ = run("lookup", "run.mcap", "wheel", "slide", "--urdf", *options)
        assert (status, rows_of(out)[0]) == (0, STAMPS)

    def test_a_warning_about_a_urdf_is_one_line(self, run, tmp_path):
        urdf = tmp_path / "arm.urdf"
        urdf.write_text(ARM.replace('mimic joint="extend"', 'mimic joint="x"'))
        path = write_mcap(tmp_path / "run.mcap", [joint_state(S, ["extend"], [0.1])])
        warned = run("check", path, "--urdf", urdf)[2]
        assert warned.startswith(f"tf2_bag check: {urdf}: joint grip mimics x, ") and warned.count("\n") == 1

    @pytest.mark.parametrize(
        ("options", "said"),
        [
            (["--poses", "/odom=map"], "expected TOPIC or TOPIC=PARENT,CHILD, got '/odom=map'"),
            (["--poses", "/odom=map,"], "expected TOPIC or TOPIC=PARENT,CHILD, got '/odom=map,'"),
            (["--poses", "=map,base"], "expected TOPIC or TOPIC=PARENT,CHILD, got '=map,base'"),
            (["--urdf", "/joint_states="], "expected FILE or TOPIC=FILE, got '/joint_states='"),
            (["--urdf", "=arm.urdf"], "expected FILE or TOPIC=FILE, got '=arm.urdf'"),
        ],
    )
    def test_wrong_options_are_refused(self, options, said, capsys):
        with pytest.raises(SystemExit):
            PARSER.read(["tf2_bag", "info", "run.mcap", *options])
        assert said in capsys.readouterr().err

    def test_what_a_urdf_lacks_is_told(self, run, drive_mcap, tmp_path):
        (tmp_path / "arm.urdf").write_text("<robot/>")
        with pytest.raises(RunError, match=r"arm.urdf: the robot has no links$"):
            run("info", drive_mcap, "--urdf", tmp_path / "arm.urdf")


class TestAdvice:
    """What is said where a frame may be missing because its topic is."""

    @pytest.mark.parametrize(
        ("messages", "options", "said"),
        [
            (
                [one for one in drive() if one.topic == "/tf"],
                [],
                "no static transforms were recorded: they are sent once, .*; `urdf` or `--urdf` computes",
            ),
            (
                [one._replace(topic=f"/a{one.topic}") if one.topic != "/tf" else one for one in drive()],
                [],
                "no static transforms are read: `topics` or `--topic` reads those on /a/tf_static",
            ),
            ([*drive(), *series("/odom", ODOMETRY)], ["--poses", "/empty"], "topic /empty has no messages"),
            (
                [*drive(), *series("/odom", ODOMETRY)],
                ["--poses", "/gone=map,gps"],
                "there is no topic /gone; the topics of its type are /empty, /odom",
            ),
            (
                [*drive(), *series("/odom", ODOMETRY)],
                ["--urdf", "/states=arm.urdf"],
                "there is no topic /states; the topics of its type are none",
            ),
        ],
    )
    def test_is_given_with_an_unknown_frame(self, run, messages, options, said, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "arm.urdf").write_text(ARM)
        path = write_mcap(tmp_path / "run.mcap", messages, topics=[("/empty", ODOMETRY)])
        with pytest.raises(RunError, match=f'"mast" passed to lookupTransform .* does not exist.*; {said}'):
            run("lookup", path, "map", "mast", *options)
        status, printed, _ = run("info", path, *options)
        assert status == 0 and re.search(f"^{said}", printed, re.MULTILINE)

    def test_is_given_where_there_is_no_transform_at_all(self, run, tmp_path):
        path = write_mcap(tmp_path / "run.mcap", [], topics=[("/empty", ODOMETRY)])
        status, printed, _ = run("check", path, "--poses", "/empty")
        assert status == 1
        assert "nothing: no transform was received (topic /empty has no messages)" in printed


def test_a_saved_buffer_has_no_publishers_to_compare(run, tmp_path):
    sent = [Sent((9 + i) * S, f"/{i % 2}/tf", [Tf("map", "base", (9 + i) * S)]) for i in range(6)]
    path, saved = write_mcap(tmp_path / "run.mcap", sent), tmp_path / "saved.mcap"
    topics = ("--topic", "/0/tf", "--topic", "/1/tf")
    status, out, _ = run("check", path, *topics)
    assert (status, out.count("publishers: base is published by 2")) == (1, 1)
    save(load(path, topics=["/0/tf", "/1/tf"]), saved)
    lack = "publishers were not compared, because a saved buffer has none"
    said = f"no problems in 2 frames (6 transforms, 5 s; {lack})\n"
    assert run("check", saved)[:2] == (0, said)
    assert run("info", saved)[1].endswith(said)


@pytest.mark.parametrize(
    ("jump", "kind", "said"),
    [
        (
            100 * S,
            "clock",
            "the stamps of base jumped ahead by 100 s, at log time 13.000 s: lookups interpolate",
        ),
        (None, "values", "base in map has different poses at 6 stamps, up to 0.25 m and 0 degrees apart"),
    ],
)
def test_check_finds_stamps_that_jump_and_stamps_with_two_poses(run, jump, kind, said, tmp_path):
    sent = []
    for i in range(6):
        ns = (9 + i) * S
        sent.append(Sent(ns, "/tf", [Tf("map", "base", ns + (jump or 0) * (i > 3))]))
        if jump is None:
            sent.append(Sent(ns + 1, "/tf", [Tf("map", "base", ns, (0.25, 0, 0))]))
    status, out, _ = run("check", write_mcap(tmp_path / "run.mcap", sent))
    assert (status, f"{kind}: {said}" in out) == (1, True)


@pytest.mark.parametrize(
    ("behind", "said"),
    [
        ({"base": 0, "lidar": 0, "arm": 10}, "clocks: the stamps of arm by /tf are 10 hours behind"),
        ({"base": 0, "arm": 10}, "clocks: the stamps of arm by /tf are 10 hours behind"),
        ({"base": 10, "lidar": 10, "arm": 0}, "clocks: the stamps of base, lidar by /tf are 10 hours behind"),
        ({"base": 10, "lidar": 10, "arm": 10}, "no problems"),
    ],
)
def test_check_finds_frames_of_two_clocks(run, behind, said, tmp_path):
    """Also if most frames, or all but one, are of a simulation, whose clock is not that of the log times."""
    hour = 3600 * S
    sent = [
        Sent(500 * hour + i * S, "/tf", [Tf(parent, child, (500 - behind[child]) * hour + i * S)])
        for i in range(6)
        for parent, child in (("map", "base"), ("base", "lidar"), ("base", "arm"))
        if child in behind
    ]
    status, out, _ = run("check", write_mcap(tmp_path / "run.mcap", sent))
    assert (status, said in out) == (int(said != "no problems"), True)


def in_frame(name, topic, ros=2):
    """A scan whose header names this frame."""
    one = scan(100 * S, 100 * S, topic, ros)
    return one._replace(content={**one.content, "header": header(100 * S, name, ros)})


@pytest.mark.parametrize(
    ("write", "name", "ros"),
    [(write_mcap, "run.mcap", 2), (write_db3, "run.db3", 2), (write_ros1, "run.bag", 1)],
)
def test_check_finds_headers_whose_frame_no_lookup_transforms(run, tmp_path, write, name, ros):
    frames = {"/scan": "lidar", "/a": "", "/b": "mast", "/b/b": "mast", "/slash": "/base"}
    sent = [*drive(30), *(in_frame(frame, topic, ros) for topic, frame in frames.items())]
    path = write(tmp_path / name, sent)
    status, out, _ = run("check", path)
    assert (status, [line for line in out.splitlines() if line.startswith("headers: ")]) == (
        1,
        [
            "headers: messages on /slash are in /base, but lookups refuse names that begin with /;"
            " `tf2_bag rewrite --rename base=base` removes the slash",
            "headers: messages on /b, /b/b are in mast, which no transform has;"
            " `tf2_bag rewrite --statics` adds one",
        ],
    )
    (tmp_path / "mast.yaml").write_text("- {frame_id: base, child_frame_id: mast}")
    written = str(tmp_path / "written.mcap")
    cures = ("--statics", str(tmp_path / "mast.yaml"), "--rename", "base=base")
    assert run("rewrite", path, *cures, "-o", written)[0] == 0
    assert "headers: " not in run("check", written)[1]


def test_headers_are_compared_with_the_frames_of_their_robot(run, tmp_path):
    sent = [*drive(30, prefix="/a"), in_frame("mast", "/a/scan"), in_frame("mast", "/b/scan")]
    path = write_mcap(tmp_path / "run.mcap", sent)
    _, out, _ = run("check", path, "--topic", "/a/tf=a/", "--topic", "/a/tf_static=a/")
    assert re.findall("headers: (.*?), which", out) == ["messages on /a/scan are in a/mast"]


def test_a_damaged_message_of_another_topic_does_not_stop_the_check(run, tmp_path):
    bad = Sent(100 * S, "/bad", b"\0\1\0\0\xff", SCAN)
    assert "headers: " not in run("check", write_mcap(tmp_path / "run.mcap", [*drive(30), bad]))[1]


def test_parents_on_both_topics_have_a_cure(run, tmp_path):
    mast = [Sent((101 + i) * S, "/tf", [Tf("mast", "camera", (101 + i) * S)]) for i in range(3)]
    path, written = write_mcap(tmp_path / "run.mcap", [*drive(60), *mast]), str(tmp_path / "written.mcap")
    out = run("check", path)[1]
    assert "mixed: camera" in out and "`tf2_bag rewrite --statics` replaces both\n" in out
    assert "; `tf2_bag rewrite --drop PARENT,camera` leaves one out\n" in out
    assert run("rewrite", path, "--drop", "mast,camera", "-o", written)[0] == 0
    assert not re.search("^(parents|mixed): ", run("check", written)[1], re.MULTILINE)


def test_a_library_that_the_end_needs_is_missed_before_the_recording_is_read(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingLibraryError, match="pyarrow is not installed: pip install"):
        run("lookup", tmp_path / "none.mcap", "a", "b", "-o", "a.parquet")


@pytest.mark.parametrize("period", [1, 5])  # a conflict, and a single change
def test_two_parents_explain_missing_connections_better_than_static_transforms(run, period, tmp_path):
    parents = [("map", "odom")[i // period % 2] for i in range(10)]
    moving = [Sent((9 + i) * S, "/tf", [Tf(one, "base", (9 + i) * S)]) for i, one in enumerate(parents)]
    path = write_mcap(tmp_path / "run.mcap", moving)
    status, printed, warned = run("lookup", path, "map", "base")
    assert (status, rows_of(printed)[2]) == (0, [str(one == "map").lower() for one in parents])
    assert warned.startswith(
        "tf2_bag lookup: no answer at 5 of 10 times: at last, Could not find a connection"
    )
    assert warned.endswith("; base has 2 parents: map, odom\n")
    for ends in (("map", "odom"), ("map", "bass")):
        with pytest.raises(RunError, match="; no static transforms were recorded"):
            run("lookup", path, *ends)


def test_lookups_at_stamps_that_are_not_set_have_no_answer(run, tmp_path):
    stamps = {"/none": [0] * 6, "/some": [100 * S, 0, 101 * S, 0]}
    scans = [scan(100 * S + i, ns, topic) for topic, all in stamps.items() for i, ns in enumerate(all)]
    path = recording(tmp_path / "drive.mcap", *scans)
    for target in ("map", "base"):
        status, printed, warned = run("lookup", path, target, "camera", "--at", "/some")
        assert (status, rows_of(printed)[2]) == (0, ["true", "false", "true", "false"])
        text = "no answer at 2 of 4 times: the stamp is not set in 2 messages of 4\n"
        assert warned == f"tf2_bag lookup: {text}"
        with pytest.raises(RunError, match="^the stamp is not set in 6 messages$"):
            run("lookup", path, target, "camera", "--at", "/none")


def test_freeze_writes_a_file_that_opens_and_says_what_is_left_out(run, drive_mcap, tmp_path):
    path = str(tmp_path / "drive.tf2")
    assert run("freeze", drive_mcap, "-o", path) == (0, f"{path}\n", "")
    assert held(Buffer.open(path)) == held(load(drive_mcap))
    sent = [*series("/odom", ODOMETRY), *series("/odom", ODOMETRY, child="")]
    odometry = write_mcap(tmp_path / "odometry.mcap", sent)
    said = "tf2_bag freeze: 20 messages on /odom are left out: child_frame_id is not set\n"
    assert run("freeze", odometry, "--poses", "/odom", "-o", path) == (0, f"{path}\n", said)


def test_json_of_info_has_the_same(run, drive_mcap):
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


@needs_dot
def test_the_tree_is_drawn(run, drive_mcap, tmp_path):
    assert run("tree", drive_mcap, "-o", tmp_path / "t.svg")[1] == f"{tmp_path}/t.svg\n"
    texts = texts_of(tmp_path / "t.svg")
    assert {"map", "odom", "base", "camera", "/tf_static", "10.0 Hz", "buffer 9.90 s"} <= set(texts)


def test_graphvizs_file_needs_no_graphviz(run, drive_mcap, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert run("tree", drive_mcap, "-o", tmp_path / "t.gv")[0] == 0
    assert "digraph" in (tmp_path / "t.gv").read_text()
    with pytest.raises(RunError, match=r"install Graphviz.*a file that ends in \.gv does not need it"):
        run("tree", drive_mcap, "-o", tmp_path / "t.svg")


def test_a_picture_of_one_message_and_of_a_part_is_drawn(run, drive_mcap, tmp_path):
    mount = Sent(100 * S, "/tf_static", [Tf("base", "camera", 100 * S)])
    path = write_mcap(tmp_path / "mount.mcap", [mount])
    assert run("plot", path, "-o", tmp_path / "p.svg")[0] == 0
    assert "static, /tf_static" in texts_of(tmp_path / "p.svg")
    assert run("plot", drive_mcap, "--start", 104, "--end", 106, "-o", tmp_path / "q.svg")[0] == 0
    ticks = [float(text) for text in texts_of(tmp_path / "q.svg") if re.fullmatch(r"[\d.]+", text)]
    assert ticks and all(104.0 <= tick <= 106.0 for tick in ticks)


# The program tf2_bag, in a Python that cannot import the packages of ROS.
WITHOUT_ROS = """
import sys
names = "rclpy geometry_msgs std_msgs sensor_msgs builtin_interfaces rcl_interfaces action_msgs rpyutils"
sys.modules.update(dict.fromkeys(names.split()))
from tf2_ros_tools.programs.tf2_bag import main
sys.exit(main())
"""


@pytest.mark.parametrize(
    "arguments",
    ["info", "check --json", "lookup map camera --at /scan", "tree", "plot --path map camera -o way.svg"],
)
def test_without_ros_it_prints_the_same(run, drive_mcap, tmp_path, monkeypatch, arguments):
    monkeypatch.chdir(tmp_path)
    name, *others = arguments.split()
    command = [name, drive_mcap, *others]
    done = subprocess.run([sys.executable, "-c", WITHOUT_ROS, *command], text=True, capture_output=True)
    assert (done.returncode, done.stdout, done.stderr) == run(*command)
