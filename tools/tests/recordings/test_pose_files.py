# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files of poses: those that are read, and what is said about the others."""

import random
import re
import tracemalloc
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from pose_file_forms import FORMS, ON_PAGE, Poses, kitti, seconds, shuffled, table, tum
from tool_paths import TOOLS

from tf2_ros.numpy import to_matrix
from tf2_ros_tools.bag import BagError
from tf2_ros_tools.recordings.pose_files import columns_of, read_kitti, read_table, read_times

S = 1_000_000_000
TUM = "timestamp tx ty tz qx qy qz qw"


def some_poses(count=5, seed=0):
    numbers = np.random.default_rng(seed)
    rotations = numbers.normal(size=(count, 4))
    rotations /= np.linalg.norm(rotations, axis=1)[:, None]
    times_ns = 1_403_636_579_763_555_584 + np.cumsum(numbers.integers(1, S, count))
    return Poses(times_ns, numbers.normal(size=(count, 3)) * [5e6, 10, 0.01], rotations)


POSES = some_poses()


def check(found, poses=POSES, atol=1e-9):
    order = np.argsort(found.times_ns)
    assert found.times_ns[order].tolist() == poses.times_ns
    matrices = to_matrix((found.translations, found.rotations))[order]
    assert_allclose(matrices, poses.matrices(), rtol=0, atol=atol)


@pytest.fixture
def read(tmp_path):
    def read(text, columns=None, times=None):
        path = tmp_path / "poses.txt"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        if times is None:
            return read_table(path, columns)
        (tmp_path / "times.txt").write_text(times)
        return read_kitti(path, read_times(tmp_path / "times.txt"), "times.txt")

    return read


@pytest.mark.parametrize("form", FORMS)
def test_the_poses_are_the_same_in_each_form(read, form):
    check(read(FORMS[form](POSES)))


SECTION = (
    (TOOLS / "docs" / "recordings.md").read_text().partition("### Files of poses\n")[2].split("\n## ")[0]
)
COLUMNS = dict(re.findall(r"^\| ([^|]+) \| `([a-z]+_?[a-z]* [^|]+)` \|$", SECTION, re.MULTILINE))


def test_the_files_of_the_page_are_refused_until_their_columns_are_named(read):
    assert COLUMNS.keys() == ON_PAGE.keys()
    for name, forms in ON_PAGE.items():
        for write in forms:
            # With all columns of OpenVINS, its heading is obeyed.
            if write != forms[-1] or not name.startswith("OpenVINS"):
                with pytest.raises(BagError, match="; to say what all columns are, pass `columns` or --traj"):
                    read(write(POSES))
            check(read(write(POSES), COLUMNS[name]))


@pytest.mark.parametrize("role", ["stamp", "position", "rotation"])
def test_each_spelling_of_the_page_is_understood(read, role):
    names = re.findall(r"`([^`]+)`", re.search(rf"^\| {role} \| (.*) \|$", SECTION, re.MULTILINE)[1])
    for name in {*names} - {"sec", "nsec"}:
        for axis in {"stamp": "t", "position": "xyz", "rotation": "xyzw"}[role]:
            spelled = re.sub(r"x(?= |$)", axis, name)
            other = {"stamp": "t", "position": axis, "rotation": f"q{axis}"}[role]
            unit = {"t_ns": 1, "time [us]": 1_000, "time(ms)": 1_000_000}.get(name, S)
            heading = [spelled if one == other else one for one in "t x y z qx qy qz qw".split()]
            poses = Poses(1_000_000 * np.arange(5), POSES.translations, POSES.rotations)
            text = table(poses, lambda ns, numbers, unit=unit: ",".join([str(Decimal(ns) / unit), *numbers]))
            check(read(",".join(heading) + "\n" + text), poses)


@given(st.permutations(range(11)), st.integers(0, 2**32))
def test_a_heading_decides_in_any_order_of_the_columns(tmp_path_factory, order, seed):
    path = tmp_path_factory.getbasetemp() / "shuffled.csv"
    path.write_text(shuffled(POSES, order, random.Random(seed)), encoding="utf-8")
    check(read_table(path))


def test_columns_that_a_user_has_named_are_those_whatever_the_file_says(read):
    named = "t_s x y z qx qy qz qw"
    for heading in (
        "# timestamp tx ty tz qw qx qy qz",
        "timestamp,x,y,z,a,b,c,d\n# y",
        "# in mm",
        "a,b,c,d,e,f,g,h",
    ):
        check(read(tum(POSES, heading, separator=","), named))
    check(read(tum(POSES), named.replace(" ", ",")))
    with pytest.raises(BagError, match=r"line 1: expected 8 columns, got 9: '1 2 3 4 0 0 0 1 9'$"):
        read("1 2 3 4 0 0 0 1 9\n", named)
    # A row that begins with a name and ends in a tab is not a heading: it has another number of columns.
    with pytest.raises(BagError, match=r"line 1: expected 9 columns, got 2: "):
        read("a 1 2 3 4 0 0 0 1\t\nb 2 2 3 4 0 0 0 1\n", f"- {named}")
    # Only the first line may be a heading, and a row that begins with a damaged number is none.
    for text, line in ((f"{TUM}\n{TUM}\n{ROW}\n", 2), (f"1x{ROW}\n{ROW}\n", 1), (f"x{ROW}\n{ROW}\n", 1)):
        with pytest.raises(BagError, match=f"line {line}: timestamp: expected a finite number, got '"):
            read(text, named)


@pytest.mark.parametrize(
    ("columns", "reason"),
    {
        "": "got ''",
        "timestamp x y z qx qy qz": "expected one column for qw, got none",
        "timestamp x y z qx qy qz qw time": "expected one column for timestamp, got 2",
        "sec nsec timestamp x y z qx qy qz qw": "timestamp, or sec and nsec, got both",
        "nsec x y z qx qy qz qw": "expected one column for timestamp, got none",
        "timestamp x [cm] y z qx qy qz qw": "expected names like timestamp .*, got 'x .cm.'",
        "timestamp x y z qx qy qz qw cov": "or - for a column that is not needed, .* got 'cov'",
        "timestamp ... x y z qx qy qz qw": "or [.][.][.] at the end, got '[.][.][.]'",
    }.items(),
)
def test_columns_are_named_once_each(columns, reason):
    with pytest.raises(ValueError, match=f"^columns: .*{reason}$"):
        columns_of(columns)


def test_kitti_has_the_stamps_in_another_file(read):
    times = "".join(f"{seconds(ns)}\n" for ns in POSES.times_ns)
    check(read(kitti(POSES), times=times))
    rounded = Poses(POSES.times_ns, POSES.translations / 1000, POSES.rotations)
    check(read(kitti(rounded, 6), times=times), rounded, atol=1e-3)
    in_ns = "".join(f"{ns},{ns}.png\n" for ns in POSES.times_ns)
    check(read(kitti(POSES), times=f"#timestamp [ns],filename\n{in_ns}"))


def test_a_stamp_keeps_all_its_digits(read):
    stamps = {
        "101.123456789": 101_123_456_789,
        "1.02e2": 102 * S,
        "1.403715529112143517e+09": 1_403_715_529_112_143_517,
        "2147483647.999999999": 2**31 * S - 1,
        "0": 0,
        "0.0000000004": 0,
        "1e-99999999999999999999": 0,
    }
    found = read("".join(f"{stamp} 1 2 3 0 0 0 1\n" for stamp in stamps))
    assert found.times_ns.tolist() == [*stamps.values()]


def test_rows_without_a_pose_are_left_out_if_the_table_says_so(read):
    heading = "stamp_ns,x,y,z,qx,qy,qz,qw,valid,gap\n"
    found = read(f"{heading}{S},nan,nan,nan,nan,nan,nan,nan,false,nan\n{2 * S},1,2,3,0,0,0,1,true,0.1\n")
    assert (found.times_ns.tolist(), found.numbers.tolist()) == ([2 * S], [3])


@pytest.mark.parametrize(
    "comment",
    [
        "# the time of the camera",
        "# t and x",
        "# https://example.org/t?x=1",
        "#",
        "####",
        "# 1.0 9 9 9 0 0 0 1",
    ],
)
def test_other_comments_do_not_matter(read, comment):
    check(read(f"{comment}\n{tum(POSES)}"))
    check(read(tum(POSES).replace("\n", f"\n{comment}\n")))


ROW = "1 2 3 4 0 0 0 1"
COMMAS = TUM.replace(" ", ",")
# What the error says after the name of the file.
REFUSED = {
    "": ": expected lines of 8 numbers, a stamp in seconds and x y z qx qy qz qw; there are none",
    "# only a comment\n": ": expected lines of 8 numbers.*; there are none",
    f"{TUM}\n": ": expected lines of 8 numbers.*; there are none",
    "1 2 3\n": "line 1: expected 8 numbers, .*, got 3: '1 2 3'; ",
    f"{ROW}\n1 2 3 4 0 0\n": "line 2: expected 8 numbers, .*, got 6: ",
    f"{TUM}\n{ROW}\n1 2 3 4 0 0\n": "line 3: expected 8 columns, got 6: '1 2 3 4 0 0'",
    f"{TUM}\n{ROW} 9\n": "line 2: .* expected names of the 9 columns, got 8; ",
    f"{TUM} cov\n{ROW}\n": "line 2: .* expected names of the 8 columns, got 9; ",
    f"frame,{COMMAS}\n{ROW.replace(' ', ',')},\n": "line 2: .* last column to have a name and a value, or",
    f"{COMMAS},\n9,{ROW.replace(' ', ',')}\n": "line 2: .* last column to have a name and a value, or",
    f"{ROW} 9\n": 'line 1: expected 8 numbers.*, such as "timestamp x y z qx qy qz qw ..."$',
    f"{ROW}\n{TUM}\n": "line 2: timestamp: expected a finite number, got 'timestamp'",
    f"{ROW}\n# timestamp tx ty tz qw qx qy qz\n": "line 2: expected one heading, before the rows, got ",
    f"# {TUM}\n# timestamp [ms] tx ty tz qx qy qz qw\n{ROW}": "line 2: expected one heading, .*stamp .ms",
    "1 0 0 0 0 0 nan 1\n": "line 1: qz: expected a finite number, got 'nan'",
    "1 0 inf 0 0 0 0 1\n": "line 1: y: expected a finite number, got 'inf'",
    "1 0 1e999 0 0 0 0 1\n": "line 1: y: expected a finite number, got '1e999'",
    "1_0 0 0 0 0 0 0 1\n": "line 1: timestamp: expected a finite number, got '1_0'",
    "1 ٣ 0 0 0 0 0 1\n": "line 1: x: expected a finite number, got '٣'",
    f"{TUM}\n1 0 0 0 0 0 - 1\n": "line 2: qz: expected a finite number, got '-'",
    f"{COMMAS}\n1,0,0,0,0,0,,1\n": "line 2: qz: expected a finite number, got ''",
    "1,5 0,0 0,0 0,0 0,0 0,0 0,0 1,0\n": "line 1: expected a heading, or spaces between numbers, as in TUM's",
    "-1 0 0 0 0 0 0 1\n": "line 1: expected a stamp of 0 or more, got -1",
    "timestamp_ns,x,y,z,qx,qy,qz,qw\n1700000000.25,0,0,0,0,0,0,1\n": "line 2: .* is not in nanoseconds",
    "1e40 0 0 0 0 0 0 1\n": "line 1: the stamp 1e40 is not in seconds",
    "2147483648 0 0 0 0 0 0 1\n": "line 1: the stamp 2147483648 is more than",
    "t_s,x,y,z,qx,qy,qz,qw\n1e40,0,0,0,0,0,0,1\n": "line 2: the stamp 1e40 is more than messages hold",
    f"t pos x pos y pos z qx qy qz qw\n{ROW} 7 8 9\n": "line 2: .* expected different names; ",
    f"# t, pos x, pos y, pos z, qx, qy, qz, qw\n{ROW} 7 8 9\n": "line 2: .* expected names of the 11",
    "t,x,y,z,roll,pitch,yaw\n1,0,0,0,0,0,0\n": "line 2: .* qx, got none; poses with angles must be arrays",
    "time;x;y;Heading\n1;0;0;0\n": "line 2: .* for z, got none; poses with angles must be arrays",
    "x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,1\n": "line 2: the heading .* one column for timestamp, got none; to say",
    "1 9 9 9 0 0 0 0\n": "line 1: expected a rotation of length 1, got the length 0; to say what all columns",
    "1 0 0 0 1 5 5 5\n": "line 1: expected a rotation of length 1, got the length 8.72",
    "1 0 0 0 1e200 0 0 0\n": "line 1: expected a rotation of length 1, got the length inf",
    "# id x y z qx qy qz qw\n0 0 0 0 0 0 0 1\n": "line 2: .* expected one column for timestamp, got none",
    "t x y z px qx qy qz qw\n1 0 0 0 0 0 0 0 1\n": "line 2: .* expected one column for x, got 2",
    "timestamp,nsec,x,y,z,qx,qy,qz,qw\n1,2,3,4,5,0,0,0,1\n": "line 2: .*timestamp, or sec and nsec, got both",
    "t,sec,x,y,z,qx,qy,qz,qw\n1,2,3,4,5,0,0,0,1\n": "line 2: .*timestamp, or sec and nsec, got both",
    "sec,nsec,x,y,z,qx,qy,qz,qw\n1,1000000000,0,0,0,0,0,0,1\n": "line 2: .*, got 1 and 1000000000",
    "sec,nsec,x,y,z,qx,qy,qz,qw\n1.5,5,0,0,0,0,0,0,1\n": "line 2: expected seconds and ns .*, got 1.5 and 5",
    "t,x,y,z,qx,qy,qz,qw,v\n1,5,0,0,0,0,0,1,0\n2,6,0,0,0,0,0,1\n": "line 3: expected 9 columns, got 8: ",
    "t [h] x y z qx qy qz qw\n1 0 0 0 0 0 0 1\n": "line 2: .* expected one column for timestamp, got none",
    "t x[cm] y z qx qy qz qw\n1 0 0 0 0 0 0 1\n": "line 2: .* expected one column for x, got none",
    f"{TUM} valid\n{ROW} 1\n": "line 2: valid: expected true or false, got '1'",
    f"id {TUM}\n1 {ROW}\n%2 {ROW}\n": "line 3: expected a row, or a comment after #, got '%2 1 2",
    f"id {TUM}\n1 {ROW}\n//2 {ROW}\n": "line 3: expected a row, or a comment after #, got '//2 1 2",
    f"##xyzwxyz\n{ROW}\n": "line 2: the comment '##xyzwxyz': ",
    f"# stamp / s x y z wq xq yq zq\n{ROW}\n": "line 2: the comment ",
    # kapture's are inverses.
    "# timestamp, device_id, qw, qx, qy, qz, tx, ty, tz\n0, a, 1, 0, 0, 0, 2, 3, 4": "line 2: .*_id' may",
    f"hello world\n{ROW}\n": "line 1: expected 8 numbers, .*, got 2: 'hello world'; ",
    "PK\3\4\0\0": "line 1: expected a text in UTF-8, got binary data$",
    ROW.encode("utf-16"): "line 1: expected a text in UTF-8, got binary data$",
    f"{ROW}\n{'1' * 20000}": "line 2: expected at most 16,384 characters$",
    "x\x1b[2J 1\n": r"line 1: .*\\x1b",
}
# Comments that may say what the columns are, and rows of which w is the first: nobody knows.
COMMENTS = [
    "(timestamp x y z qw qx qy qz)",
    "[timestamp, x, y, z, qw, qx, qy, qz]",
    "1:timestamp 2:tx 3:ty 4:tz 5:qw 6:qx 7:qy 8:qz",
    "timestamp p(x,y,z) q(w,x,y,z)",
    "time x y z qw qx qy qz: all in m",
    "frame_time X Y Z Q0 Q1 Q2 Q3",
    "unix_time east north up qw qx qy qz",
    "t/x/y/z/qw/qx/qy/qz",
    "timestamp tx ty tz w x y z",
    "stamp position quaternion_wxyz",
    "quaternions are w x y z",
    "unix_time x y z rotation_w rotation_x rotation_y rotation_z",
    "column 5: qw",
    "positions in mm",
    "x y z in millimetres",
    "time px py pz ow ox oy oz",
    "fields time tx ty tz rotW rotX rotY rotZ",
    "timestamp tx ty tz rw rx ry rz",
    "time x y z qw_world_device qx_world_device qy_world_device qz_world_device",
    "t x y z e0 e1 e2 e3",
    "the unit of time is ns",
    "format wxyz",
    "scalar first",
    "qwqxqyqz",
    "t rot pos",
    "t [msec]",
    "time usec pose",
    "time [min]",
    "unit: inch",
    "feet",
    "columns: time east north up real i j k",
    "delta_t|linear_velocity_x|linear_velocity_y|a|b",
    "!time [s] east north up a b c d",
    "time /p/x /p/y /p/z qr qi qj qk",
]
REFUSED |= {f"# {comment}\n1 1 2 3 1 0 0 0\n": "line 2: the comment .* expected " for comment in COMMENTS}
# Headings of other columns than those of poses.
REFUSED |= {
    f"{names.replace(' ', ',')}\n1,9,9,9,0,0,0,1\n": "line 2: .* expected one column for x, got none"
    for names in (
        "time p_dot_x p_dot_y p_dot_z q_dot_x q_dot_y q_dot_z q_dot_w",
        "time twist.position.x twist.position.y twist.position.z qx qy qz qw",
        "time p_cov_x p_cov_y p_cov_z qx qy qz qw",
    )
}


# Columns that may be a part of the stamp, or say which rows have no pose, or that of another robot.
REFUSED |= {
    f"{COMMAS},{name}\n{ROW.replace(' ', ',')},7\n": f"line 2: .* the column '{re.escape(name)}' may be"
    for name in (
        "ns",
        "!t [ns]",
        "dt",
        "nanosec",
        "header.stamp.secs",
        "usec",
        "time_fraction",
        "is_valid",
        "valid [bool]",
        "ok",
        "date",
        "gps_week",
        "tracking_ok",
        "is_good",
        "status",
        "outlier",
        "tracking_state",
        "converged",
        "robot_id",
        "frame_id",
        "source",
        "child_frame",
    )
}
REFUSED |= {
    f"#fields: t_s\tt_ns\tx\ty\tz\tqx\tqy\tqz\tqw\n5\t{ROW.replace(' ', chr(9))}\n": "line 2: .*'fields: t_s'"
}
# No heading has these.
REFUSED |= {
    f"{row}\n{ROW}\n": "line 1: timestamp: expected a finite number" for row in ("nan " * 8, "- " * 8)
}


@pytest.mark.parametrize("text", REFUSED, ids=lambda text: repr(text[:40]))
def test_what_is_not_understood_is_refused_in_one_line(read, text):
    with pytest.raises(BagError, match=f"poses.txt(, )?({REFUSED[text]})") as raised:
        read(text)
    assert str(raised.value).isprintable()
    assert len(str(raised.value)) < 1000


@pytest.mark.parametrize("text", ["t " * 5000, f"-{'1' * 5000}{' 0' * 7}", "\x1b" * 5000 + "\n1"])
def test_long_names_and_lines_are_shortened_in_errors(read, text):
    with pytest.raises(BagError) as raised:
        read(f"{text}\n{ROW}\n")
    assert len(str(raised.value)) < 1000


WRONG_OF_KITTI = {
    "1 0 0 0 0 1 0 0 0 0 1\n": "line 1: expected 12 numbers, the first three rows of a matrix, got 11",
    "1 0 0 0 0 1 0 0 0 0 1 nan\n": "line 1: row 3, column 4: expected a finite number, got 'nan'$",
    "1 0 0 0 0 1 0 0 0 0 2 0\n": "line 1: the numbers are not a rotation matrix and a position$",
    "1 0 0 0 0 1 0 0 0 0 -1 0\n": "line 1: the numbers are not a rotation matrix and a position$",
    "1e200 0 0 0 0 1 0 0 0 0 1 0\n": "line 1: the numbers are not a rotation matrix and a position$",
    "1 0 0 0 0 1 0 0 0 0 1 0\n" * 2: "a stamp for each of the 2 poses in .*poses.txt, got 1 in times.txt$",
    "# mm\n1 0 0 0 0 1 0 0 0 0 1 0\n": "line 2: the comment '# mm': expected names of the 12",
    "# r11 r21 r31 tx\n1 0 0 0 0 1 0 0 0 0 1 0\n": "line 2: the comment .*: expected names of the 12",
    "poses\n1 0 0 0 0 1 0 0 0 0 1 0\n": "line 1: expected 12 numbers, .*, got 1: 'poses'$",
}


@pytest.mark.parametrize("text", WRONG_OF_KITTI)
def test_wrong_files_of_kitti_are_named(read, text):
    with pytest.raises(BagError, match=WRONG_OF_KITTI[text]):
        read(text, times="100\n")


WRONG_TIMES = {
    "1 2\n": "times.txt, line 1: expected one number, .*, got 2: '1 2'; .*, such as .timestamp -., or",
    "1700000000000000000\n": "not in seconds .name it timestamp_ns, .*, such as .timestamp., or",
    "# stamps in ms\n1\n": "line 2: the comment '# stamps in ms': expected names of the 1 columns, got 3; ",
    "# usecs\n17\n": "line 2: the comment '# usecs': expected .*",
    "# hours\n17\n": "line 2: the comment '# hours': expected .*",
    "# dt\n17\n": "line 2: the comment '# dt': expected .*",
    "label\ttime\tstamp\n\t1\t2\n": "line 2: .* expected one column for timestamp, got 2; ",
    "a\n": "times.txt: expected lines of one number, a stamp in seconds; there are none$",
    "": "times.txt: expected lines of one number, a stamp in seconds; there are none$",
}


@pytest.mark.parametrize("times", WRONG_TIMES)
def test_wrong_files_of_stamps_are_named(read, times):
    with pytest.raises(BagError, match=WRONG_TIMES[times]):
        read("1 0 0 0 0 1 0 0 0 0 1 0\n", times=times)


def test_the_remedy_for_a_file_of_stamps_works(read):
    stamps = "1.5 rgb/1.png 1.52 depth/1.png\n"
    with pytest.raises(BagError, match='such as "timestamp - - -"') as raised:
        read("1 0 0 0 0 1 0 0 0 0 1 0\n", times=stamps)
    heading = str(raised.value).split('"')[-2]
    assert read("1 0 0 0 0 1 0 0 0 0 1 0\n", times=f"{heading}\n{stamps}").times_ns.tolist() == [3 * S // 2]


@pytest.mark.parametrize(("unit", "factor"), [("ns", 1), ("us", 1_000), ("ms", 1_000_000)])
def test_stamps_that_are_not_in_seconds_are_noticed_until_the_unit_is_named(read, unit, factor):
    poses = Poses([ns // factor * factor for ns in POSES.times_ns], POSES.translations, POSES.rotations)
    text = table(poses, lambda ns, numbers: " ".join([str(ns // factor), *numbers]))
    for heading in ("", f"# {TUM}\n", f"{TUM}\n"):
        with pytest.raises(
            BagError, match="is not in seconds .name it timestamp_ns, .*; to say what all columns are"
        ):
            read(heading + text)
    for stamp in ("timestamp [s]", "timestamp(s)", "timestamp_s"):
        with pytest.raises(BagError, match="is more than messages hold"):
            read(TUM.replace("timestamp", stamp) + "\n" + text)
    for stamp in (f"timestamp [{unit}]", f"timestamp({unit})", f"timestamp_{unit}"):
        check(read(TUM.replace("timestamp", stamp) + "\n" + text), poses)
    check(read(text, f"t_{unit} x y z qx qy qz qw"), poses)


# Large files.


def log_lines(file):
    for i in range(200_000):
        file.write(f"[INFO] [{i}]: a line of a log\n".encode())


def a_pose_and_a_log(file):
    file.write(f"{ROW}\n".encode())
    log_lines(file)


LARGE = {
    "zeros": lambda file: file.truncate(1 << 30),
    "spaces": lambda file: file.write(b" " * (1 << 24)),
    "empty lines": lambda file: file.write((b" " * 100 + b"\n") * (1 << 17)),
    "comments": lambda file: file.write((b"#" * 100 + b"\n") * (1 << 17)),
    "a log": log_lines,
    "a pose and a log": a_pose_and_a_log,
}


@pytest.mark.parametrize("kind", LARGE)
def test_a_large_file_of_another_kind_takes_little_memory(tmp_path, kind):
    with open(tmp_path / "large", "wb") as file:
        LARGE[kind](file)
    times_ns = np.zeros(1, np.int64)
    tracemalloc.start()
    try:
        for read in (read_table, read_times, lambda path: read_kitti(path, times_ns, "times")):
            with pytest.raises(BagError, match="large(, line |: expected lines of)"):
                read(tmp_path / "large")
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()
