# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The terms of the model: times, errors, and what a lookup accepts beyond tf2's."""

from typing import NamedTuple

S = 1_000_000_000  # ns
STAMPS_END = 2**31 * S  # messages carry seconds as int32
NEWEST = "newest"  # as a time: that of the newest sample, whatever its stamp
RESERVED = "NO_PARENT"


def seconds(ns):
    sign, ns = ("-", -ns) if ns < 0 else ("", ns)
    return f"{sign}{ns // S}.{ns % S:09d}"


def span(ns):
    """How long: in seconds; from a day on in days, from a year on in years."""
    day = 86400 * S
    if ns < day:
        return f"{seconds(ns)} s"
    number, unit = (ns / day, "day") if ns < 365.25 * day else (ns / (365.25 * day), "year")
    number = f"{number:.3g}"
    return f"{number} {unit}" if number == "1" else f"{number} {unit}s"


class ModelError(Exception):
    """
    What a lookup raises: the name of tf2's class, and the text, or one of several.

    ``of_tf2`` begins with the sentence that tf2 raises, if that may be another one.
    """

    def __init__(self, kind, *texts, of_tf2=None):
        super().__init__(texts[0])
        self.kind, self.texts, self.of_tf2 = kind, texts, of_tf2


class Policy(NamedTuple):
    """What a lookup accepts beyond tf2's; in ns. A limit may be pairs: the names of frames, and theirs."""

    tolerance: int | tuple = 0
    extrapolate: bool = False
    max_gap: int | None = None
    max_age: int | tuple | None = None


TF2 = Policy()


def require_stamps(*times):
    """Which of several is quoted does not matter."""
    unfit = [seconds(ns) for ns in times if not -STAMPS_END <= ns < STAMPS_END]
    if unfit:
        texts = [f"the time {one} s does not fit into the stamp of a message" for one in unfit]
        raise ModelError("OverflowError", *texts)


def limit_of(limits, name, others):
    """The limit of one frame; `others`: that of frames that pairs do not name."""
    return dict(limits).get(name, others) if isinstance(limits, tuple) else limits
