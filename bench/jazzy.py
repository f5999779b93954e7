"""
Owns what tf2 of ROS 2 Jazzy takes where it is not at hand: figures of one machine, carried over to this one.

Debian's tf2 was measured beside Jazzy's there, once. Here it is measured beside ours, and what it takes here
over what it took there carries Jazzy's figures over. Jazzy's `Buffer` takes 3.1 times what Debian's
`lookup_transform_core` takes on 4 hops at recent times, so 15 times Jazzy's is 5 times Debian's. In deep
history Debian's search is faster than Jazzy's: there, 5 times Debian's asks for more than 15 times Jazzy's.
"""

from __future__ import annotations

import statistics
from collections.abc import Mapping

from bench.rows import Rows

Cell = tuple[str, int]  # place, hops

# In ns.
CPP: dict[Cell, int] = {
    ("static", 1): 160, ("static", 4): 400, ("static", 10): 510,
    ("past", 1): 1700, ("past", 4): 4300, ("past", 10): 5900,
    ("latest", 1): 170, ("latest", 4): 360, ("latest", 10): 440,
}  # fmt: skip
BUFFER: dict[Cell, int] = {
    ("static", 1): 10_500, ("static", 4): 11_600, ("static", 10): 12_200,
    ("past", 1): 13_100, ("past", 4): 18_100, ("past", 10): 21_700,
    ("latest", 1): 10_400, ("latest", 4): 10_900, ("latest", 10): 11_200,
}  # fmt: skip
SET_TRANSFORM = 2700
# Debian's there: 4 dynamic hops, 1000 samples per frame, by place.
DEBIAN_CPP = {"newest": 580, "random": 690, "oldest": 590}
DEBIAN_CORE = {"newest": 3500}
CHAIN = "chain of 1000"


def cpp_factor(rows: Rows) -> float | None:
    """What Debian's C++ takes here over what it took there; None where it was not measured."""
    return _factor(rows, "ros1_cpp", DEBIAN_CPP)


def python_factor(rows: Rows) -> float | None:
    """The same of Debian's Python."""
    return _factor(rows, "ros1_py", DEBIAN_CORE)


def _factor(rows: Rows, who: str, there: Mapping[str, int]) -> float | None:
    here = {place: rows.find("lookups", who, "core", tree=CHAIN, place=place) for place in there}
    found = [row.median / there[place] for place, row in here.items() if row is not None]
    return statistics.median(found) if found else None


def carried(ns: float, factor: float | None) -> float | None:
    """A figure of there, as it would be here."""
    return None if factor is None else ns * factor
