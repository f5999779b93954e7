# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A rewritten recording that a player publishes: what nodes in other processes hear, early and late ones."""

import cmath
from typing import NamedTuple

import numpy as np
import pytest
from making_bags import (
    ANY,
    LATCHED,
    ODOMETRY,
    SCAN,
    STRING,
    TF,
    S,
    Sent,
    drive,
    header,
    posed,
    raw,
    scan,
    store,
    write_db3,
    write_mcap,
)
from obeying_processes import Obeying
from rotations import Turn
from times_and_transforms import about_z

from tf2_ros_tools.bag import Trajectory, rewrite

BEGIN, COUNT = 100, 40  # in seconds, and of the odometry, ten a second
MEASURED = [*range(0, COUNT, 3)]  # at which of them a scan was taken
LIDAR = (0.0, 0.1, 0.7)  # in `base`
VOLATILE = "- {history: keep_last, depth: 1, reliability: reliable, durability: volatile}"
LISTEN = "listener = Listener()"
TOPICS = {"/tf": TF, "/scan": SCAN, "/odom": ODOMETRY, "/text": STRING}


def measured(prefix=""):
    """The messages of all topics without transforms, with prefixes of their frames."""
    found = []
    for i in MEASURED:
        ns = BEGIN * S + i * S // 10
        one = scan(ns + 2_000_000, ns)
        own = {"header": header(ns, f"{prefix}lidar"), "ranges": np.array([i, 0.5], np.float32)}
        found.append(one._replace(content=one.content | own))
        odometry = posed(ns, float(i), "/odom", ODOMETRY, f"{prefix}odom", f"{prefix}base")
        found.append(odometry._replace(log_ns=ns + 3_000_000))
        found.append(Sent(ns + 4_000_000, "/text", {"data": "ä" * i}, STRING))
    return found


def recorded(*, with_statics):
    some = [one for one in drive(COUNT, begin_ns=BEGIN * S) if with_statics or one.topic == "/tf"]
    return sorted([*some, *measured()], key=lambda one: one.log_ns)


# Poses in the plane: a complex position, and an angle.


def then(a, b):
    """The pose in the first frame of what has the pose b in the second one, whose pose is a."""
    return a[0] + cmath.rect(1, a[1]) * b[0], a[1] + b[1]


def inverted(a):
    return -cmath.rect(1, -a[1]) * a[0], -a[1]


def driven(i):
    """Of `base` in `odom`; see `drive`."""
    return cmath.rect(1, i / 10), i / 10


def recorded_poses():
    """Of `base` in `map`."""
    return [then((0.01 * i, 0.001 * i), driven(i)) for i in MEASURED]


KEYFRAMES = {0: (5 + 1j, 0.2), 20: (2 - 1j, 2.5), 39: (-4 + 2j, 3.5)}  # of `base` in `map`, by the odometry


def corrected_poses():
    """The correction, of `odom` in `map`, is interpolated between the keyframes."""
    corrections = {i: then(pose, inverted(driven(i))) for i, pose in KEYFRAMES.items()}
    x, y, angle = (
        np.interp(MEASURED, [*corrections], [part(one) for one in corrections.values()])
        for part in (lambda one: one[0].real, lambda one: one[0].imag, lambda one: one[1])
    )
    return [then((complex(*at), turn), driven(i)) for i, *at, turn in zip(MEASURED, x, y, angle, strict=True)]


def of_lidar(poses):
    """What a buffer answers for the lidar, by the poses of `base`: x y z and x y z w."""
    found = []
    for pose in poses:
        position, angle = then(pose, (complex(*LIDAR[:2]), 0.0))
        found.append([position.real, position.imag, LIDAR[2], *Turn(about_z(angle)).canonical()])
    return found


class Case(NamedTuple):
    """A recording, what is changed with the prefix "r1/" except of `map`, and what tf2 must know then."""

    path: object
    changes: dict
    statics: dict  # the parents of static frames
    poses: list  # of the lidar in `map`


def with_new_statics(folder):
    """A recording in mcap without static transforms gets some, and a trajectory."""
    (folder / "own.tum").write_text(
        "".join(
            f"{BEGIN + i / 10} {at.real} {at.imag} 0 {' '.join(map(str, about_z(angle)))}\n"
            for i, (at, angle) in KEYFRAMES.items()
        )
    )
    (folder / "own.yaml").write_text(
        "- {frame_id: r1/base, child_frame_id: r1/lidar, y: 0.1, z: 0.7}\n"
        "- {frame_id: r1/lidar, child_frame_id: r1/lens, x: 0.25}\n"
    )
    changes = {
        "trajectory": Trajectory(folder / "own.tum", "map", "odom", "base"),
        "statics": folder / "own.yaml",
    }
    sent = recorded(with_statics=False)
    path = write_mcap(folder / "run.mcap", sent, qos=dict.fromkeys(TOPICS, VOLATILE))
    statics = {"r1/lidar": "r1/base", "r1/lens": "r1/lidar"}
    return Case(path, changes, statics, of_lidar(corrected_poses()))


def with_more_statics(folder):
    """A recording in db3 with two messages of static transforms gets more, and a new mount of its camera."""
    (folder / "own.yaml").write_text(
        "- {frame_id: r1/lidar, child_frame_id: r1/camera, x: 1.5}\n"
        "- {frame_id: r1/base, child_frame_id: r1/imu}\n"
    )
    qos = dict.fromkeys(TOPICS, [ANY]) | {"/tf_static": [LATCHED]}
    path = write_db3(folder / "run.db3", recorded(with_statics=True), qos=qos)
    statics = {"r1/lidar": "r1/base", "r1/camera": "r1/lidar", "r1/imu": "r1/base"}
    return Case(path, {"statics": folder / "own.yaml"}, statics, of_lidar(recorded_poses()))


@pytest.fixture
def start(processes):
    """Start a process that runs a statement."""

    def started(statement):
        # With the same modules, a server imports them only once.
        one = Obeying("run_by_player", "run_by_listener")
        processes.append(one)
        one.do("from run_by_player import *; from run_by_listener import *")
        one.do(statement)
        return one

    return started


@pytest.mark.parametrize("make", [with_new_statics, with_more_statics])
def test_nodes_hear_what_was_rewritten(start, tmp_path, make):
    case, written = make(tmp_path), tmp_path / "written.mcap"
    rewrite(case.path, written, prefix="r1/", rename={"map": "map"}, **case.changes)
    player, listener = start(f"player = Player({str(written)!r})"), start(LISTEN)
    player.until("not player.topics_without_subscriber()")
    player.do("player.play()")

    counts = dict.fromkeys(("/scan", "/odom", "/text"), len(MEASURED))
    listener.until(f"listener.counts() == {counts}")
    newest_ns = [BEGIN * S + (COUNT - 1) * S // 10] * 2
    listener.until(f"listener.newest_ns() == {newest_ns}")
    listener.until(f"listener.parents(static=True) == {case.statics}")
    assert listener.do("listener.parents(static=False)") == {"r1/odom": "map", "r1/base": "r1/odom"}
    for topic in counts:
        heard = [decoded_again(one, topic) for one in listener.do(f"listener.serialized({topic!r})")]
        assert heard == [raw(one) for one in measured("r1/") if one.topic == topic]
    poses = np.array(listener.do("listener.poses('map', '/scan')"))
    poses[:, 3:] = Turn(poses[:, 3:]).canonical()
    np.testing.assert_allclose(poses, case.poses, rtol=0, atol=1e-9)

    late = start(LISTEN)
    late.until("listener.parents(static=True)")
    assert late.do("listener.parents(static=True)") == case.statics
    assert late.do("listener.parents(static=False)") == {}


def decoded_again(text, topic):
    """A message that rclpy has serialized, as rosbags serializes it: the bytes between fields may differ."""
    return bytes(
        store().serialize_cdr(store().deserialize_cdr(bytes.fromhex(text), TOPICS[topic]), TOPICS[topic])
    )
