# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fuzz files of poses of all kinds: what cannot be read is a BagError, and takes little memory."""

import tempfile
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from reliability.fuzz.buffer_checks import Fault
from tf2_ros_tools.recordings.bag_reader import BagError
from tf2_ros_tools.recordings.pose_files import LAST_NS, StampedPoses, read_kitti, read_table, read_times

MOST_BYTES = 6000
MOST_MEMORY = 4_000_000  # bytes, of which the decoder of text takes most
_folder = tempfile.TemporaryDirectory(prefix="tf2-fuzz-", dir="/dev/shm")
_POSES, _TIMES = Path(_folder.name) / "poses.txt", Path(_folder.name) / "times.txt"
_KINDS = 4


def run(data: bytes) -> None:
    """Read one file, or two of KITTI; the first byte selects the kind, two more are the size of the first."""
    kind, text = (data[0] if data else 0) % _KINDS, data[1:]
    if kind == 2:
        size = int.from_bytes(text[:2], "little")
        _TIMES.write_bytes(text[2 + size :])
        text = text[2 : 2 + size]
    _POSES.write_bytes(text)
    tracemalloc.start()
    try:
        if kind == 0:
            _check(read_table(_POSES))
        elif kind == 3:
            _check(read_table(_POSES, "- timestamp_ns x y z qw qx qy qz ..."))
        elif kind == 1:
            _check_times(read_times(_POSES))
        else:
            _check(read_kitti(_POSES, read_times(_TIMES), "times.txt"))
    except BagError as error:
        if not str(error).isprintable() or len(str(error)) > 1000:
            raise Fault(f"not one short line: {error}") from error
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    if peak > MOST_MEMORY:
        raise Fault(f"{peak} bytes of memory for {len(data)} of input")


def _check(poses: StampedPoses) -> None:
    _check_times(poses.times_ns)
    count = len(poses)
    if poses.translations.shape != (count, 3) or poses.rotations.shape != (count, 4):
        raise Fault(f"{count} poses, {poses.translations.shape} and {poses.rotations.shape} numbers")
    lengths = np.linalg.norm(poses.rotations, axis=1)
    if not (np.isfinite(poses.translations).all() and (abs(lengths - 1.0) < 0.2).all()):
        raise Fault(f"not poses: {poses}")
    if (np.diff(poses.numbers) <= 0).any() or poses.numbers[0] < 1:
        raise Fault(f"not lines: {poses.numbers}")


def _check_times(times_ns: np.ndarray) -> None:
    if times_ns.dtype != np.int64 or not len(times_ns) or times_ns.min() < 0 or times_ns.max() > LAST_NS:
        raise Fault(f"not stamps: {times_ns}")


def seeds() -> Iterator[bytes]:
    """Small files of each kind, and of some that are refused."""
    row = "1.5 1 2 3 0 0 0 1\n"
    tables = [
        row * 2,
        f"# timestamp tx ty tz qx qy qz qw\n{row}",
        "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"
        "1700000000000000001,1,2,3,1,0,0,0\n",
        "sec,nsec,x,y,z,qx,qy,qz,qw\n1,5,1,2,3,0,0,0,1\n",
        "stamp_ns,x,y,z,qx,qy,qz,qw,valid,gap\n1,nan,nan,nan,nan,nan,nan,nan,false,nan\n2,1,2,3,0,0,0,1,true,0\n",
        "t (ms) x [mm] y [km] z qx qy qz qw cov\n1e3 1 2 3 0 0 0 1\n",
        "header.stamp,pose.position.x,pose.position.y,pose.position.z,orientation.x,q_y,q.z,quat_w\n1,1,2,3,0,0,0,1",
        f"# format: {row}{row}1 2 3\n",
        "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n",
        "1,5 0,0 0,0 0,0 0,0 0,0 0,0 1,0\n",
        "1700000000000000000 1 2 3 0 0 0 1\n",
        "time\tx\ty\tz\tqx\tqy\tqz\tqw\tplace\n1\t1\t2\t3\t0\t0\t0\t1\ta b\n",
        "\ufeff" + row.replace(" ", ";"),
    ]
    yield b"\3" + b"frame,t,x,y,z,qw,qx,qy,qz,\nmap,1,1,2,3,1,0,0,0,\n"
    yield from (b"\0" + table.encode() for table in tables)
    yield from (
        b"\1" + times.encode() for times in ("1\n2.5e0\n", "# t\n1 a\n", "timestamp [us],file\n1,a.png\n")
    )
    matrices = b"1 0 0 5 0 1 0 6 0 0 1 7\n0 -1 0 1 1 0 0 2 0 0 1 3\n"
    for times in (b"1\n2\n", b"1\n", b"time [ns]\n1\n2\n"):
        yield b"\2" + len(matrices).to_bytes(2, "little") + matrices + times
