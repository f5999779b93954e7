# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Owns the transforms of a stress run: each number of a sample follows from its frame and stamp.

Most frames move linearly and turn at a constant rate, so what is interpolated between any two whole samples
is known, also where late samples arrive. EXACT has unrelated numbers at each step, and all its steps are
inserted in order: an answer that was interpolated between other samples than the two neighbors is wrong.
CUP changes its parent with each sample.
"""

import itertools

import numpy as np
from geometry_msgs.msg import TransformStamped

S = 1_000_000_000  # ns
STEP_NS = 10_000_000
START_NS = 1000 * S
CACHE_S = 1.0

WORLD, EXACT, CUP = "world", "exact", "cup"
HANDS = ("left hand", "right hand")
PARENTS = {
    "a0": WORLD,
    "a1": "a0",
    "a2": "a1",
    "b0": WORLD,
    "b1": "b0",
    "net0": WORLD,
    "net1": "net0",
    "net2": "net1",
    EXACT: WORLD,
}
STATIC_PARENTS = {"camera": "a2", HANDS[0]: WORLD, HANDS[1]: WORLD}
NUMBERS = {name: i for i, name in enumerate((*PARENTS, *STATIC_PARENTS, CUP))}
SENT = ("net0", "net1", "net2")  # by the publisher
TOLERANCE = 1e-6
_PRIME = 1_000_003


def _turned(quaternions, vectors):
    real, imaginary = quaternions[:, 3:], quaternions[:, :3]
    across = 2 * np.cross(imaginary, vectors)
    return vectors + real * across + np.cross(imaginary, across)


def _product(a, b):
    xyz = a[:, 3:] * b[:, :3] + b[:, 3:] * a[:, :3] + np.cross(a[:, :3], b[:, :3])
    w = a[:, 3] * b[:, 3] - np.einsum("ij,ij->i", a[:, :3], b[:, :3])
    return np.column_stack((xyz, w))


def composed(outer, inner):
    """Poses one after the other, as pairs of arrays of translations and quaternions."""
    return outer[0] + _turned(outer[1], inner[0]), _product(outer[1], inner[1])


def inverse(pose):
    back = pose[1] * (-1, -1, -1, 1)
    return -_turned(back, pose[0]), back


def _about_axis(number, angles):
    axis = np.array((1 + number, 2, 3 - number / 2))
    axis /= np.linalg.norm(axis)
    return np.column_stack((np.sin(angles / 2)[:, None] * axis, np.cos(angles / 2)))


def _unrelated(steps, which):
    return (steps * (7919 + 104729 * which) % _PRIME) * (2 / _PRIME) - 1


def pose_in_parent(frame, times_ns):
    """What a sample of the frame holds, or is interpolated, at these times."""
    number = NUMBERS[frame]
    seconds = times_ns / S
    if frame in STATIC_PARENTS:
        seconds = np.zeros_like(seconds) + number
    if frame == EXACT:
        steps, part = np.divmod(times_ns, STEP_NS)
        numbers = [
            _unrelated(steps, which) * (1 - part / STEP_NS) + _unrelated(steps + 1, which) * part / STEP_NS
            for which in range(4)
        ]
        return np.column_stack(numbers[:3]), _about_axis(number, numbers[3])
    velocity = (1 + number / 10, -0.5 - number / 15, 0.3 + number / 20)
    return seconds[:, None] * velocity, _about_axis(number, (0.2 + number / 50) * seconds)


def pose_in_world(frame, times_ns):
    if frame == WORLD:
        return np.zeros((len(times_ns), 3)), np.tile((0.0, 0.0, 0.0, 1.0), (len(times_ns), 1))
    if frame == CUP:
        # Between two samples with different parents, the older one answers.
        steps = times_ns // STEP_NS
        inside = pose_in_parent(CUP, steps * STEP_NS)
        left, right = (composed(pose_in_world(hand, times_ns), inside) for hand in HANDS)
        is_right = (steps % 2 == 1)[:, None]
        return np.where(is_right, right[0], left[0]), np.where(is_right, right[1], left[1])
    parent = PARENTS.get(frame) or STATIC_PARENTS[frame]
    return composed(pose_in_world(parent, times_ns), pose_in_parent(frame, times_ns))


def check(target, source, times_ns, translations, rotations):
    """Compare answers, rows of arrays, with what they must be; AssertionError for the first that differs."""
    times_ns = np.asarray(times_ns, np.int64)
    wanted = composed(inverse(pose_in_world(target, times_ns)), pose_in_world(source, times_ns))
    wrong = np.abs(translations - wanted[0]).max(axis=1) > TOLERANCE
    # A quaternion and its negative are the same rotation.
    wrong |= np.abs(np.abs(np.einsum("ij,ij->i", rotations, wanted[1])) - 1) > TOLERANCE**1.5
    wrong |= (
        np.minimum(np.abs(rotations - wanted[1]).max(axis=1), np.abs(rotations + wanted[1]).max(axis=1))
        > TOLERANCE
    )
    wrong |= ~np.isfinite(translations).all(axis=1)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise AssertionError(
            f"{source} in {target} at {times_ns[row]}: {translations[row]}, {rotations[row]} instead of "
            f"{wanted[0][row]}, {wanted[1][row]}"
        )


def stamp_ns(message):
    return message.header.stamp.sec * S + message.header.stamp.nanosec


def check_message(target, source, message, time_ns=0):
    """The same for a message, which tells its time."""
    assert (message.header.frame_id, message.child_frame_id) == (target, source), message
    assert time_ns in (0, stamp_ns(message)), (time_ns, message)
    t, q = message.transform.translation, message.transform.rotation
    check(
        target,
        source,
        [stamp_ns(message)],
        np.array([(t.x, t.y, t.z)]),
        np.array([(q.x, q.y, q.z, q.w)]),
    )


def sample(frame, time_ns):
    """The message of one sample."""
    message = TransformStamped(child_frame_id=frame)
    if frame == CUP:
        message.header.frame_id = HANDS[time_ns // STEP_NS % 2]
    else:
        message.header.frame_id = PARENTS.get(frame) or STATIC_PARENTS[frame]
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(time_ns, S)
    xyz, xyzw = pose_in_parent(frame, np.array([time_ns]))
    for part, numbers, names in (
        (message.transform.translation, xyz, "xyz"),
        (message.transform.rotation, xyzw, "xyzw"),
    ):
        for name, number in zip(names, numbers[0], strict=True):
            setattr(part, name, float(number))
    return message


STATIC = [sample(frame, START_NS) for frame in STATIC_PARENTS]
FRAMES = [WORLD, *NUMBERS]
ADDED = ("never", "own")  # how the names begin of the frames that are added in the end, and by children
# Of frames whose histories overlap: each group has its own writer, as fast as it can.
_GROUPS = ("a0", "a1", "a2", "camera"), ("b0", "b1"), SENT, (EXACT,), (CUP,)
PAIRS = [
    pair
    for group in _GROUPS
    for pair in itertools.product((WORLD, *HANDS, *group), repeat=2)
    if pair[0] != pair[1]
]
