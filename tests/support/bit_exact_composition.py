# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Compose the transforms of hops with the arithmetic of `geometry_header.pxi`, so that the answer of a lookup is
reached to the last bit.

A transform is x y z and x y z w, both tuples of floats.
"""

import math

from times_and_transforms import rotation, translation

IDENTITY = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def multiply(a, b):
    return (
        a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] + a[1] * b[3] + a[2] * b[0] - a[0] * b[2],
        a[3] * b[2] + a[2] * b[3] + a[0] * b[1] - a[1] * b[0],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    )


def rotate(q, v):
    x, y, z, w = q
    tx, ty, tz = 2.0 * (y * v[2] - z * v[1]), 2.0 * (z * v[0] - x * v[2]), 2.0 * (x * v[1] - y * v[0])
    return (
        v[0] + w * tx + (y * tz - z * ty),
        v[1] + w * ty + (z * tx - x * tz),
        v[2] + w * tz + (x * ty - y * tx),
    )


def compose(outer, inner):
    moved = rotate(outer[1], inner[0])
    return tuple(a + b for a, b in zip(moved, outer[0], strict=True)), multiply(outer[1], inner[1])


def canonical(q):
    lead = q[3] if 4.0 * q[3] * q[3] > 1.0 else max(q[:3], key=abs)
    return tuple(-a for a in q) if lead < 0.0 else q


def climbed(hops):
    """From the first frame up all hops, composed from the top down."""
    made = IDENTITY
    for i, hop in enumerate(reversed(hops)):
        numbers = translation(hop.transform), rotation(hop.transform)
        made = compose(made, numbers) if i else numbers
    return made


def composed_hops(hops):
    """The answer of a simple lookup."""
    source = climbed([hop for hop in hops if hop.direction == "up"])
    downwards = [hop for hop in reversed(hops) if hop.direction == "down"]
    if downwards:
        target = climbed(downwards)
        back = (-target[1][0], -target[1][1], -target[1][2], target[1][3])
        apart = tuple(a - b for a, b in zip(source[0], target[0], strict=True))
        source = rotate(back, apart), multiply(back, source[1])
    x, y, z, w = source[1]
    scale = 1.0 / math.sqrt(x * x + y * y + z * z + w * w)
    return source[0], canonical(tuple(a * scale for a in source[1]))


def composed_halves(explanation):
    """The answer of a lookup at two times."""
    halves = [
        (translation(half.transform), rotation(half.transform))
        for half in (explanation.target, explanation.source)
    ]
    made = compose(*halves)
    return made[0], canonical(made[1])
