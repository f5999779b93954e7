# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files of poses: those that are read, and what is said about the others."""

import json
import random
import re
import shutil
import subprocess
import tracemalloc

import numpy as np
import pytest
from geometry_msgs.msg import Quaternion
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from pose_file_forms import FORMS, Poses, kitti, seconds, shuffled, table, tum, w_first

from tf2_geometry_msgs import rpy_from_quaternion
from tf2_ros.numpy import to_arrays, to_matrix
from tf2_ros_tools.bag import BagError
from tf2_ros_tools.recordings.pose_files import read_kitti, read_table, read_times

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
    def read(text, times=None):
        path = tmp_path / "poses.txt"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        if times is None:
            return read_table(path)
        (tmp_path / "times.txt").write_text(times)
        return read_kitti(path, tmp_path / "times.txt")

    return read


@pytest.mark.parametrize("form", FORMS)
def test_the_poses_are_the_same_in_each_form(read, form):
    check(read(FORMS[form](POSES)))


@given(st.permutations(range(11)), st.integers(0, 2**32))
def test_a_heading_decides_in_any_order_of_the_columns(tmp_path_factory, order, seed):
    path = tmp_path_factory.getbasetemp() / "shuffled.csv"
    path.write_text(shuffled(POSES, order, random.Random(seed)), encoding="utf-8")
    check(read_table(path))


def test_kitti_has_the_stamps_in_another_file(read):
    times = "".join(f"{seconds(ns)}\n" for ns in POSES.times_ns)
    check(read(kitti(POSES), times))
    rounded = Poses(POSES.times_ns, POSES.translations / 1000, POSES.rotations)
    check(read(kitti(rounded, 6), times), rounded, atol=1e-3)
    in_ns = "".join(f"{ns},{ns}.png\n" for ns in POSES.times_ns)
    check(read(kitti(POSES), f"#timestamp [ns],filename\n{in_ns}"))


def test_a_stamp_keeps_all_its_digits(read):
    stamps = {
        "101.123456789": 101_123_456_789,
        "1.02e2": 102 * S,
        "1.403715529112143517e+09": 1_403_715_529_112_143_517,
        "2147483647.999999999": 2**31 * S - 1,
        "0": 0,
        "0.0000000004": 0,
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
        f"# {TUM}\n# by {TUM[:12]}",
        f"# format: {TUM}",
    ],
)
def test_other_comments_do_not_matter(read, comment):
    text = tum(POSES)
    check(read(f"{comment}\n{text}"))
    if TUM not in comment:
        check(read(text.replace("\n", f"\n{comment}\n")))


ROW = "1 2 3 4 0 0 0 1"
EUROC = "p_RS_R_x p_RS_R_y p_RS_R_z q_RS_x q_RS_y q_RS_z q_RS_w"
# What the error says after the name of the file.
REFUSED = {
    "": ": expected lines of 8 numbers, a stamp in seconds and x y z qx qy qz qw; there are none",
    "# only a comment\n": ": expected lines of 8 numbers.*; there are none",
    f"{TUM}\n": ": expected lines of 8 numbers.*; there are none",
    "1 2 3\n": "line 1: expected 8 numbers, .*, got '1 2 3'; poses need a position and a rotation$",
    f"{ROW}\n1 2 3 4 0 0\n": "line 2: expected 8 numbers, .* the row is cut off$",
    f"{TUM}\n{ROW}\n1 2 3 4 0 0\n": "line 3: the row is cut off before qz, qw: '1 2 3 4 0 0'$",
    f"{TUM}\n{ROW} 9\n": "line 2: expected at most the 8 columns of the heading, got 9$",
    f"{ROW} 9\n": f"line 1: expected 8 numbers.*; add a first line .*: {TUM}; or, if qw .*: timestamp tx",
    f"{ROW}\n{TUM}\n": "line 2: expected 8 numbers",
    f"{ROW}\n# timestamp tx ty tz qw qx qy qz\n": "line 2: the heading differs from what is before it$",
    f"# {TUM}\n# timestamp [ms] tx ty tz qx qy qz qw\n": "line 2: the heading differs",
    "1 0 0 0 0 0 nan 1\n": "line 1: qz: expected a finite number, got 'nan'$",
    "1 0 inf 0 0 0 0 1\n": "line 1: ty: expected a finite number, got 'inf'$",
    "NaN 0 0 0 0 0 0 1\n": "line 1: timestamp: expected a finite number, got 'NaN'$",
    f"{TUM}\n1 0 0 0 0 0 - 1\n": "line 2: qz: expected a finite number, got '-'$",
    f"{TUM.replace(' ', ',')}\n1,0,0,0,0,0,,1\n": "line 2: qz: expected a finite number, got ''$",
    "-1 0 0 0 0 0 0 1\n": "line 1: expected a stamp of 0 or more, got -1$",
    "1e40 0 0 0 0 0 0 1\n": "line 1: the stamp 1e40 is too large: messages cannot hold 1e\\+40 s$",
    "2147483648 0 0 0 0 0 0 1\n": "line 1: the stamp 2147483648 is too large",
    "1 9 9 9 0 0 0 0\n": "line 1: expected a rotation of length 1, got the length 0; if the columns ",
    "1 0 0 0 1 5 5 5\n": f"line 1: expected a rotation of length 1, got the length 8.72; .*: {TUM}; or",
    f"{TUM}\n1 0 0 0 1 5 5 5\n": "line 2: expected a rotation of length 1, got the length 8.72$",
    "1 0 0 0 1e200 0 0 0\n": "line 1: expected a rotation of length 1, got the length inf",
    "time x y z\n": "line 1: the heading has no column for qx, qy, qz, qw; its names are like timestamp tx",
    "# time x y z\n": "line 1: the heading has no column for qx, qy, qz, qw; its names are like timestamp tx",
    "# id x y z qx qy qz qw\n0 0 0 0 0 0 0 1\n": "line 1: the heading has no column for timestamp; ",
    f"{TUM} time\n": "line 1: .* several columns for timestamp: timestamp, time; rename the others$",
    "t x y z px qx qy qz qw\n": "line 1: the heading has several columns for tx: x, px; rename the others$",
    "timestamp,nsec,x,y,z,qx,qy,qz,qw\n": "line 1: .* several columns for timestamp: timestamp, nsec; rename",
    "sec,nsec,x,y,z,qx,qy,qz,qw\n1,1000000000,0,0,0,0,0,0,1\n": "line 2: expected .*, got 1 and 1e.09$",
    "sec,nsec,x,y,z,qx,qy,qz,qw\n1.5,5,0,0,0,0,0,0,1\n": "line 2: expected whole seconds .*, got 1.5 and 5$",
    "sec,x,y,z,qx,qy,qz,qw,nsec\n1,0,0,0,0,0,0,1\n": "line 2: the row is cut off before nanoseconds",
    "sec,nsec,usec,x,y,z,qx,qy,qz,qw\n": "line 1: .* several columns for nanoseconds: nsec, usec; rename",
    "t,x,y,z,qx,qy,qz,qw,v\n1,5,0,0,0,0,0,1,0\n2,6,0,0,0,0,0,1\n": "line 3: expected 9 columns, as in the"
    " first row, got 8: '2,6,0,0,0,0,0,1'$",
    "t [h] x y z qx qy qz qw\n": r"line 1: the unit of the column t\[h\] is not one of ns, .*, seconds$",
    "t x[ft] y z qx qy qz qw\n": r"line 1: the unit of the column x\[ft\] is not one of m, .*, mm$",
    "t x y z qx [deg] qy qz qw\n": r"line 1: the unit of the column qx\[deg\] is not one of ",
    "hello world\n": f"line 1: expected 8 numbers.*, got 'hello world'; the names of columns are like {TUM}$",
    "{\n": "line 1: expected 8 numbers",
    "<xml>\n": "line 1: expected 8 numbers",
    "PK\3\4\0\0": "line 1: expected a text in UTF-8, got binary data$",
    ROW.encode("utf-16"): "line 1: expected a text in UTF-8, got binary data$",
    b"\x1f\x8b\x08\xff\xfe\n": "line 1: expected 8 numbers",
    f"{ROW}\n{'1' * 20000}": "line 2: expected at most 16,384 characters$",
    "x\x1b[2J\n": r"line 1: .*\\x1b",
    f"# {TUM}\n{TUM}\n": "line 2: timestamp: expected a finite number, got 'timestamp'$",
    f"# timestamp {EUROC}\n1.5 0 0 0 0 0 0 1\n": "line 2: in EuRoC's format, stamps are in ns, but 1.5 is not"
    r"; name its unit in the heading, such as: timestamp \[s\]$",
}


@pytest.mark.parametrize("text", REFUSED, ids=lambda text: repr(text[:40]))
def test_what_is_not_understood_is_refused_in_one_line(read, text):
    with pytest.raises(BagError, match=f"poses.txt(, )?{REFUSED[text]}") as raised:
        read(text)
    assert str(raised.value).isprintable()


LONG = "t" * 5000
LONG_NAMES = {
    "t " * 5000: "several columns for timestamp: t, t, t, t, t, t, t, t, …; rename the others$",
    '"' * 5000 + "t[h] x y z qx qy qz qw": 'the unit of the column "{80}… is not one of ',
    f"time{LONG} x y z qx qy qz qw": "; if timet{76}… is the stamp, call it timestamp",
    f"-{'1' * 5000} 0 0 0 0 0 0 1": "expected a finite number, got '-1{79}…'$",
    f"-0.{'1' * 5000} 0 0 0 0 0 0 1": "expected a stamp of 0 or more, got -0.1{77}…$",
    "\x1b" * 5000: "got '.{,160}…'; the names of columns are like ",
}


@pytest.mark.parametrize("text", LONG_NAMES, ids=lambda text: repr(text[:8]))
def test_long_names_and_lines_are_shortened_in_errors(read, text):
    with pytest.raises(BagError, match=LONG_NAMES[text]) as raised:
        read(text)
    assert len(str(raised.value)) < 1000


WRONG_OF_KITTI = {
    "1 0 0 0 0 1 0 0 0 0 1\n": "line 1: expected 12 numbers, the first three rows of a matrix, got",
    f"{ROW}\n": "line 1: expected 12 numbers.*; a file that has the stamps is read without `times`$",
    "1 0 0 0 0 1 0 0 0 0 1 nan\n": "line 1: row 3, column 4: expected a finite number, got 'nan'$",
    "1 0 0 0 0 1 0 0 0 0 2 0\n": "line 1: the numbers are not a rotation matrix and a position$",
    "1 0 0 0 0 1 0 0 0 0 -1 0\n": "line 1: the numbers are not a rotation matrix and a position$",
    "1e200 0 0 0 0 1 0 0 0 0 1 0\n": "line 1: the numbers are not a rotation matrix and a position$",
    "1 0 0 0 0 1 0 0 0 0 1 0\n" * 2: "a stamp for each of the 2 poses in .*poses.txt, got 1 in .*times.txt$",
    "poses\n": "poses.txt, line 1: expected 12 numbers",
    "r11 r12 r13 t1 r21\n": "line 1: .*; the format of KITTI has no heading: tail -n \\+2 FILE$",
}


@pytest.mark.parametrize("text", WRONG_OF_KITTI)
def test_wrong_files_of_kitti_are_named(read, text):
    with pytest.raises(BagError, match=WRONG_OF_KITTI[text]):
        read(text, "100\n")


WRONG_TIMES = {
    "1 2\n": r"times.txt, line 1: expected one number.*add a first line such as: timestamp \[ns\],file$",
    "1700000000000000000\n": r"not in seconds; if it is in ns, add the first line: timestamp \[ns\]$",
    "a\n": "times.txt, line 1: expected one number, a stamp in seconds, got 'a'$",
    "": "times.txt: expected lines of one number, a stamp in seconds; there are none$",
}


@pytest.mark.parametrize("times", WRONG_TIMES)
def test_wrong_files_of_stamps_are_named(read, times):
    with pytest.raises(BagError, match=WRONG_TIMES[times]):
        read("1 0 0 0 0 1 0 0 0 0 1 0\n", times)


# What an error advises, done.


@pytest.mark.parametrize(("unit", "factor"), [("ns", 1), ("us", 1_000), ("ms", 1_000_000)])
def test_a_heading_with_the_unit_of_stamps_is_a_remedy(read, unit, factor):
    poses = Poses([ns // factor * factor for ns in POSES.times_ns], POSES.translations, POSES.rotations)
    text = table(poses, lambda ns, numbers: " ".join([str(ns // factor), *numbers]))
    with pytest.raises(
        BagError, match=f"is not in seconds; if it is in {unit}, add a first line that names all columns"
    ) as raised:
        read(text)
    check(read(f"{advised(raised.value)[0]}\n{text}"), poses)
    text = f"# {TUM}\n{text}"
    with pytest.raises(BagError, match="say so in the heading: ") as raised:
        read(text)
    _, name = str(raised.value).split("say so in the heading: ")
    check(read(text.replace("timestamp", name)), poses)


@pytest.mark.parametrize(
    ("names", "factor"),
    {
        "sec,nsec": 1,
        "secs,nanos": 1,
        "sec,usec": 1_000,
        "sec,msecs": 1_000_000,
        "stamp_sec,stamp_nsec": 1,
        "timestamp.sec,timestamp.nanosec": 1,
        "/odom/header/stamp/sec,/odom/header/stamp/nanosec": 1,
        "t_s,t_us": 1_000,
    }.items(),
)
def test_a_stamp_may_have_two_columns(read, names, factor):
    poses = Poses([ns // factor * factor for ns in POSES.times_ns], POSES.translations, POSES.rotations)

    def row(ns, numbers):
        seconds, rest = divmod(ns, S)
        return ",".join([str(seconds), str(rest // factor), *numbers])

    check(read(f"{names},x,y,z,qx,qy,qz,qw\n{table(poses, row)}"), poses)


def test_positions_may_have_a_unit_behind_an_underscore(read):
    in_cm = Poses(POSES.times_ns, 100.0 * np.array(POSES.translations), POSES.rotations)
    text = table(in_cm, lambda ns, numbers: ",".join([f"{ns}", *numbers]))
    check(read(f"t_ns,x_cm,ty_cm,position.z_cm,qx,qy,qz,qw\n{text}"), POSES)


@pytest.mark.parametrize(("unit", "factor"), [("ns", 1), ("us", 1_000), ("ms", 1_000_000)])
@pytest.mark.parametrize("name", ["t [s]", "timestamp(s)", "stamp_s"])
def test_a_wrong_unit_of_stamps_in_the_heading_is_noticed(read, name, unit, factor):
    poses = Poses([ns // factor * factor for ns in POSES.times_ns], POSES.translations, POSES.rotations)
    text = table(poses, lambda ns, numbers: ",".join([str(ns // factor), *numbers]))
    heading = "{},x,y,z,qx,qy,qz,qw\n{}"
    with pytest.raises(BagError, match=f"too large.*; if it is in {unit}, say so in the heading: ") as raised:
        read(heading.format(name, text))
    check(read(heading.format(str(raised.value).rpartition(": ")[2], text)), poses)


@pytest.mark.parametrize("name", ["ts [ns]", "TS(ns)", "ts_nsec", "timestamp_ns", "time_nanoseconds", "t_ns"])
def test_a_stamp_has_many_names(read, name):
    check(read(table(POSES, lambda ns, numbers: ",".join([str(ns), *numbers]), f"{name},x,y,z,qx,qy,qz,qw")))


def test_the_parts_of_a_stamp_may_be_fields_of_messages(read):
    names = "header.stamp.sec,header.stamp.nanosec,x,y,z,qx,qy,qz,qw"
    check(read(table(POSES, lambda ns, numbers: ",".join([f"{ns // S},{ns % S}", *numbers]), names)))


@pytest.mark.parametrize("name", ["timestamp_kf", "nav_time", "Timestamp nanosec"])
def test_a_column_that_may_be_the_stamp_is_named(read, name):
    text = table(POSES, lambda ns, numbers: ",".join([str(ns), *numbers]), f"#{name},x,y,z,qx,qy,qz,qw")
    with pytest.raises(BagError, match=f"no column for timestamp; .*; if #?{name} is the stamp, ") as raised:
        read(text)
    called = str(raised.value).split("timestamp, or ")[1].split(" if it is in ns")[0]
    check(read(text.replace(name, called)))


def test_a_heading_for_columns_that_are_not_needed_is_a_remedy(read):
    text = "".join(f"{line} 0.1 0.2\n" for line in tum(POSES).splitlines())
    with pytest.raises(BagError, match="such as: ") as raised:
        read(text)
    check(read(f"{advised(raised.value)[0]} c1 c2\n{text}"))


def advised(error):
    """The headings for a file without one, in which w comes last or first."""
    return (
        str(error)
        .partition("such as: ")[2]
        .split("; or, if qw comes before qx, as VINS and EuRoC write it: ")
    )


@pytest.mark.parametrize("velocities", [(), ("0.1", "0.2", "0.3")])
@pytest.mark.parametrize("begin_ns", [0, 48_367_000_000 - POSES.times_ns[0]])
def test_files_of_vins_are_read_with_the_advised_heading(read, velocities, begin_ns):
    poses = Poses(np.array(POSES.times_ns) + begin_ns, POSES.translations, POSES.rotations)
    text = w_first(poses, "", str, more=(*velocities, ""))
    with pytest.raises(BagError, match="as VINS and EuRoC write it: timestamp \\[ns\\] tx") as raised:
        read(text)
    names = [advised(raised.value)[1], *(f"v{i}" for i in range(len(velocities)))]
    check(read(f"{' '.join(names)}\n{text}"), poses)


ELEMENTS = {
    "r11": "t x y z r11 r12 r13 r21 r22 r23 r31 r32 r33",
    "R_00": "# time,x,y,z,R_00,R_01,R_02,R_10,R_11,R_12,R_20,R_21,R_22",
    "m00": "timestamp px py pz m00 m01 m02 m10 m11 m12 m20 m21 m22",
    "R[0][0]": "t x y z R[0][0] R[0][1] R[0][2] R[1][0] R[1][1] R[1][2] R[2][0] R[2][1] R[2][2]",
    "R(1,1)": "t x y z R(1,1) R(1,2) R(1,3) R(2,1) R(2,2) R(2,3) R(3,1) R(3,2) R(3,3)",
    "T00": "T00 T01 T02 T03 T10 T11 T12 T13 T20 T21 T22 T23",
}


@pytest.mark.parametrize("kind", ELEMENTS)
def test_rotation_matrices_are_converted_as_the_error_says(read, kind):
    with pytest.raises(BagError, match="of a rotation matrix, the columns qx qy qz qw are") as raised:
        read(f"{ELEMENTS[kind]}\n{'1 ' * 13}\n")
    names = [f"r{row}{column}" for row in "123" for column in "123"]
    matrices = POSES.matrices()[:, :3, :3].reshape(-1, 9)
    check_advised(read, str(raised.value), [dict(zip(names, one, strict=True)) for one in matrices])


def test_seven_numbers_may_be_named_as_angles(read):
    with pytest.raises(
        BagError, match="if they are a stamp, a position and angles, add the first line"
    ) as raised:
        read("1 2 3 4 5 6 7\n")
    heading = str(raised.value).partition("first line: ")[2].partition(";")[0]
    with pytest.raises(BagError, match="of angles in radians, the columns qx qy qz qw are"):
        read(f"{heading}\n1 2 3 4 5 6 7\n")


@pytest.mark.parametrize(
    "heading",
    [
        "t x y z roll pitch yaw",
        "time,x,y,z,euler_x,euler_y,euler_z",
        "t x y z rx yaw r11",
        "VERTEX3 0 1 2 3 0.1 0.2 0.3",
    ],
)
def test_angles_are_converted_as_the_error_says(read, heading):
    with pytest.raises(BagError, match="of angles in radians, the columns qx qy qz qw are") as raised:
        read(f"{heading}\n1 2 3 4 5 6 7\n")
    angles = [rpy_from_quaternion(Quaternion(x=x, y=y, z=z, w=w)) for x, y, z, w in POSES.rotations.tolist()]
    check_advised(
        read,
        str(raised.value),
        [{"roll": roll, "pitch": pitch, "yaw": yaw} for roll, pitch, yaw in angles],
    )


def check_advised(read, advice, rotations):
    """Convert with the code in the error, once for each rotation."""
    pytest.importorskip("scipy")
    imports, code = advice.split("`")[1::2]
    names = {}
    exec(imports, names)
    rows = [
        f"{seconds(ns)} {x!r} {y!r} {z!r} {' '.join(map(repr, eval(code, names, rotation).tolist()))}\n"
        for ns, (x, y, z), rotation in zip(
            POSES.times_ns, POSES.translations.tolist(), rotations, strict=True
        )
    ]
    check(read("".join(rows)))


def test_numbered_parts_of_a_quaternion_are_named_as_the_error_says(read):
    text = w_first(POSES, "t,x,y,z,q_0,q_1,q_2,q_3")
    with pytest.raises(BagError, match="qw qx qy qz if the real part is the first") as raised:
        read(text)
    named = str(raised.value).split("quaternion ")[1].split(" if ")[0].replace(" ", ",")
    check(read(text.replace("q_0,q_1,q_2,q_3", named)))


COLMAP = "# Image list\n#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"


@pytest.mark.parametrize("heading", [COLMAP, ""])
def test_the_poses_of_colmap_are_inverted_as_the_error_says(read, heading):
    pytest.importorskip("scipy")
    row = "1 0.8 0.2 0.4 -0.2 -2.6 3 0.6 1 a b.JPG\n1.5 2.5 -1\n"
    with pytest.raises(
        BagError, match="Of the camera, qx qy qz qw are -qx -qy -qz qw, and tx ty tz are"
    ) as raised:
        read(heading + row)
    imports, code = str(raised.value).split("`")[1::2]
    names = {}
    exec(imports, names)
    in_cameras = to_arrays(np.linalg.inv(POSES.matrices()))
    rows = []
    for ns, (tx, ty, tz), (qx, qy, qz, qw) in zip(POSES.times_ns, *in_cameras, strict=True):
        position = eval(code, names, {"tx": tx, "ty": ty, "tz": tz, "qx": qx, "qy": qy, "qz": qz, "qw": qw})
        rows.append(f"{seconds(ns)} {' '.join(map(str, [*position, -qx, -qy, -qz, qw]))}\n")
    # Of far positions, the inverse has fewer digits.
    check(read("".join(rows)), atol=1e-8)


TIMES = "".join(f"{seconds(ns)}\n" for ns in POSES.times_ns)
PLANAR = Poses(  # its angles are not within half a turn
    POSES.times_ns,
    POSES.translations * [1, 1, 0],
    [[0, 0, np.sin(angle / 2), np.cos(angle / 2)] for angle in (0.0, -3.1, 7.5, 1e-9, 1.5)],
)
PLANAR_ROWS = [
    f"{x!r} {y!r} {angle!r}"
    for (x, y, _), angle in zip(PLANAR.translations.tolist(), (0.0, -3.1, 7.5, 1e-9, 1.5), strict=True)
]
WITHOUT_STAMPS = "".join(f"{line.partition(' ')[2]}\n" for line in tum(POSES).splitlines())
MATRICES = kitti(POSES).splitlines()
BY_COMMAND = {
    "poses without stamps": WITHOUT_STAMPS,
    "a graph of g2o": "".join(
        f"VERTEX_SE3:QUAT {i} {line}\n" for i, line in enumerate(WITHOUT_STAMPS.splitlines())
    )
    + "EDGE_SE3:QUAT 0 1 0 0 0 0 0 0 1\n",
    "a graph of g2o with parameters first": "PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1\n"
    + "".join(f"VERTEX_SE3:QUAT {i} {line}\n" for i, line in enumerate(WITHOUT_STAMPS.splitlines())),
    "a 2-D graph of g2o": "FIX 0\n"
    + "".join(f"VERTEX_SE2 {i} {line}\n" for i, line in enumerate(PLANAR_ROWS))
    + "VERTEX_XY 5 1 2\nEDGE_SE2 0 1 0.5 0 0 1 0 0 1 0 1\n",
    "a 2-D graph of TORO": "".join(f"VERTEX2 {i} {line}\n" for i, line in enumerate(PLANAR_ROWS))
    + "EDGE2 0 1 0.5 0 0 1 0 1 1 0 0\n",
    "JSON of nuScenes": json.dumps(
        [
            {"token": "a", "timestamp": ns // 1000, "rotation": [w, x, y, z], "translation": xyz}
            for ns, xyz, (x, y, z, w) in zip(
                POSES.times_ns, POSES.translations.tolist(), POSES.rotations.tolist(), strict=True
            )
        ],
        indent=0,
    ),
    "2-D poses with stamps": "".join(
        f"{seconds(ns)} {row}\n" for ns, row in zip(POSES.times_ns, PLANAR_ROWS, strict=True)
    ),
    "2-D poses with stamps and commas": "".join(
        f"{seconds(ns)}, {row.replace(' ', ', ')}\n"
        for ns, row in zip(POSES.times_ns, PLANAR_ROWS, strict=True)
    ),
    "decimal commas": tum(POSES).replace(".", ","),
    "semicolons": tum(POSES, separator=";").replace(".", ","),
}


in_a_shell = pytest.mark.skipif(
    not (shutil.which("awk") and shutil.which("paste")), reason="the advised commands use awk and paste"
)


@in_a_shell
@pytest.mark.parametrize("kind", BY_COMMAND)
def test_an_advised_command_makes_a_file_that_can_be_read(read, tmp_path, kind):
    (tmp_path / "times.txt").write_text(TIMES)
    with pytest.raises(BagError, match="(python3|paste|awk|tr) ") as raised:
        read(BY_COMMAND[kind])
    command = str(raised.value).partition(": ")[2]
    command = command[re.search("(python3|paste|awk|tr) ", command).start() :].replace("FILE", "poses.txt")
    made = subprocess.run(command, shell=True, cwd=tmp_path, capture_output=True, check=True).stdout
    in_us = Poses([ns // 1000 * 1000 for ns in POSES.times_ns], POSES.translations, POSES.rotations)
    check(read(made), PLANAR if "2-D" in kind else in_us if "JSON" in kind else POSES)


def test_json_in_one_long_line_gets_the_same_advice(read):
    with pytest.raises(
        BagError, match="expected at most 16,384 characters; write JSON in rows; .*: python3 -c "
    ):
        read(json.dumps([{"timestamp": 1, "image_id": 0}] * 1000))


@in_a_shell
def test_a_point_cloud_of_poses_becomes_a_table_of_angles(read, tmp_path):
    text = (
        "# .PCD v0.7 - Point Cloud Data\nVERSION 0.7\nFIELDS x y z intensity roll pitch yaw time\n"
        "SIZE 4 4 4 4 4 4 4 8\nTYPE F F F F F F F F\nDATA ascii\n1 2 3 0 0.1 0.2 0.3 1700000000.5\n"
    )
    with pytest.raises(BagError, match="a point cloud of poses, .*: sed ") as raised:
        read(text)
    command = str(raised.value).partition("in rows: ")[2].partition(" FILE;")[0]
    made = subprocess.run(
        f"{command} poses.txt", shell=True, cwd=tmp_path, capture_output=True, check=True, text=True
    ).stdout
    assert made == "x y z intensity roll pitch yaw time\n1 2 3 0 0.1 0.2 0.3 1700000000.5\n"
    with pytest.raises(BagError, match="of angles in radians, the columns qx qy qz qw are"):
        read(made)


@pytest.mark.parametrize("more", [5, 8, 9])
def test_as_many_columns_as_a_matrix_has_may_be_named_in_a_heading(read, more):
    text = w_first(POSES, "", str, more=["0.5"] * more)
    with pytest.raises(BagError, match="; otherwise, add a first line") as raised:
        read(text)
    names = [advised(raised.value)[1], *(f"c{i}" for i in range(more))]
    check(read(f"{' '.join(names)}\n{text}"))


@in_a_shell
@pytest.mark.parametrize("separator", [" ", "   ", ",", ", "])
@pytest.mark.parametrize("kind", ["a stamp and a matrix", "a matrix", "an index and a matrix"])
def test_advised_commands_make_files_of_kitti(read, tmp_path, kind, separator):
    first = TIMES.splitlines() if "stamp" in kind else map(str, range(5)) if "index" in kind else [""] * 5
    ends = "" if "stamp" in kind else " 0 0 0 1"
    lines = [f"{one} {line}{ends}".strip() for one, line in zip(first, MATRICES, strict=True)]
    said = "if the first number is the stamp, " if "stamp" in kind else f"if it is {kind}, .*`times`"
    with pytest.raises(BagError, match=said) as raised:
        read("\n".join(lines).replace(" ", separator))
    commands = [
        one.replace("FILE", "poses.txt") for one in str(raised.value).split("`") if one.startswith("awk")
    ]
    made = [
        subprocess.run(one, shell=True, cwd=tmp_path, capture_output=True, check=True, text=True).stdout
        for one in commands
    ]
    check(read(made[0], made[-1] if "stamp" in kind else TIMES))


@in_a_shell
def test_the_advised_command_turns_a_matrix_that_is_written_column_by_column(read, tmp_path):
    matrices = (POSES.matrices().transpose(0, 2, 1)).reshape(-1, 16).tolist()
    with pytest.raises(BagError, match="if it is a matrix, .*`times`") as raised:
        read("\n".join(" ".join(map(str, one)) for one in matrices))
    command = str(raised.value).split("`")[1].replace("FILE", "poses.txt")
    made = subprocess.run(
        command, shell=True, cwd=tmp_path, capture_output=True, check=True, text=True
    ).stdout
    check(read(made, TIMES))


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
def test_a_large_file_of_another_kind_is_refused_without_being_read_whole(tmp_path, kind):
    with open(tmp_path / "large", "wb") as file:
        LARGE[kind](file)
    tracemalloc.start()
    try:
        for read in (read_table, read_times, lambda path: read_kitti(path, path)):
            with pytest.raises(BagError, match="large, line "):
                read(tmp_path / "large")
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()
