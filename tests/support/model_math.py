# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Owns rotations and transforms of the model, as tuples.

A translation is x y z, a rotation x y z w, and a transform a pair of both.
"""

import math

IDENTITY = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def product(p, q):
    px, py, pz, pw = p
    qx, qy, qz, qw = q
    return (
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
        pw * qw - px * qx - py * qy - pz * qz,
    )


def conjugate(q):
    x, y, z, w = q
    return (-x, -y, -z, w)


def turned(q, v):
    x, y, z, _ = product(product(q, (*v, 0.0)), conjugate(q))
    return (x, y, z)


def added(u, v):
    return tuple(a + b for a, b in zip(u, v, strict=True))


def difference(u, v):
    return tuple(a - b for a, b in zip(u, v, strict=True))


def cross(u, v):
    return (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])


def composed(outer, inner):
    """Of parent <- frame and frame <- child: parent <- child."""
    return (added(turned(outer[1], inner[0]), outer[0]), product(outer[1], inner[1]))


def inverse(transform):
    back = conjugate(transform[1])
    return (turned(back, tuple(-a for a in transform[0])), back)


def canonical(q):
    """Of q and -q the one that tf2 makes of a rotation matrix."""
    x, y, z, w = q
    trace = 4 * w * w - 1
    leading = w if trace > 0 else max((x, y, z), key=abs)
    return (-x, -y, -z, -w) if leading < 0 else q


def slerp(p, q, ratio):
    """Along the shorter way."""
    dot = sum(a * b for a, b in zip(p, q, strict=True))
    if dot < 0:
        q, dot = tuple(-a for a in q), -dot
    angle = math.acos(min(1.0, dot))
    if angle < 1e-6:
        mixed = tuple((1 - ratio) * a + ratio * b for a, b in zip(p, q, strict=True))
    else:
        before, after = math.sin((1 - ratio) * angle), math.sin(ratio * angle)
        mixed = tuple((before * a + after * b) / math.sin(angle) for a, b in zip(p, q, strict=True))
    length = math.sqrt(sum(a * a for a in mixed))
    return tuple(a / length for a in mixed)
