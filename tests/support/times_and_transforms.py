# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Makes the objects that tests are about."""

import math

from messages_with_or_without_ros import Time, TransformStamped

S = 1_000_000_000  # ns


def at(seconds):
    return Time(nanoseconds=round(seconds * S))


def at_ns(ns):
    return Time(nanoseconds=ns)


def about_z(angle):
    """The quaternion x y z w of a turn about z, in radians."""
    return (0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2))


def transform(parent, child, seconds=0.0, xyz=(0.0, 0.0, 0.0), xyzw=(0.0, 0.0, 0.0, 1.0), *, ns=None):
    m = TransformStamped()
    m.header.frame_id, m.child_frame_id = parent, child
    m.header.stamp.sec, m.header.stamp.nanosec = divmod(round(seconds * S) if ns is None else ns, S)
    t, q = m.transform.translation, m.transform.rotation
    t.x, t.y, t.z = map(float, xyz)
    q.x, q.y, q.z, q.w = map(float, xyzw)
    return m


def insert(buffer, parent, child, *seconds):
    """Insert one sample for each of these times."""
    buffer.set_transforms([transform(parent, child, one) for one in seconds], "x")


def translation(m):
    t = m.transform.translation
    return (t.x, t.y, t.z)


def rotation(m):
    q = m.transform.rotation
    return (q.x, q.y, q.z, q.w)


def stamp_ns(m):
    return m.header.stamp.sec * S + m.header.stamp.nanosec
