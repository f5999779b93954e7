"""
Owns the transforms that a buffer and the model receive: their names, numbers and messages.

A link is (parent, child, ns, x, turn): `x` and `turn` say which transform.
"""

import math
from types import SimpleNamespace

from making import transform
from model import STAMPS_END

FRAMES = ("a", "b", "c", "d", "e", "f", "g", "h")
ODD_NAMES = ("", "/a", "//b", "/", "NO_PARENT", "nowhere")
AUTHORITIES = ("one", "two")
# Some are others times -1, 2 or -2: whoever normalises those gets the same bits, so they repeat a sample.
TURNS = (
    (0.0, 0.0, 0.0, 1.0),
    (0.0, 0.0, 0.0, -2.0),
    (0.1, 0.2, 0.3, 0.4),
    (-0.2, -0.4, -0.6, -0.8),
    (0.0, 1.0, 0.0, 0.0),
    (0.6, 0.0, -0.8, 0.1),
    (-0.5, 0.1, 0.7, -0.3),
    (0.0, 0.0, -1e-150, 2e-150),
    (0.0, 0.0, 1.5e-154, -0.0),
    (1e150, 0.0, 0.0, 1e153),
    (0.0, 0.0, 0.0, 0.0),
    (0.0, math.nan, 0.0, 1.0),
    (1e200, 0.0, 0.0, 0.0),
    (0.0, 0.0, 1e-162, 1.6e-162),  # the square is subnormal
    (0.0, 1e-155, 0.0, 1e-155),
)
GOOD_TURNS = 10  # the first ones
PLACES = (0.0, 1.0, -2.5, 0.125, 1e3, math.nan, math.inf)
GOOD_PLACES = 5
WAYS = ("set", "static", "list", "static list", "cdr", "static cdr")


def place(x):
    """The translation that a link names by an index of PLACES, or by a larger number."""
    x = PLACES[x] if x < len(PLACES) else float(x)
    return (x, 2 * x + 0.5, -x)


def message(link):
    parent, child, ns, x, turn = link
    xyz = place(x)
    if -STAMPS_END <= ns < STAMPS_END:
        return transform(parent, child, xyz=xyz, xyzw=TURNS[turn], ns=ns)
    # A message cannot carry it.
    made = transform(parent, child, xyz=xyz, xyzw=TURNS[turn])
    header = SimpleNamespace(stamp=SimpleNamespace(nanoseconds=ns), frame_id=parent)
    return SimpleNamespace(header=header, child_frame_id=child, transform=made.transform)
