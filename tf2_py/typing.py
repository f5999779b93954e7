"""Owns the types of times and durations, for the signatures of this project and of programs."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

__all__ = ["DurationLike", "HasNanoseconds", "HasSecNanosec", "TimeLike", "TimeoutLike", "TimesLike"]


class HasNanoseconds(Protocol):
    """An rclpy ``Time`` or ``Duration``, or what counts like them."""

    @property
    def nanoseconds(self) -> int: ...


class HasSecNanosec(Protocol):
    """A ``builtin_interfaces/Time`` or ``Duration``, or what has their fields."""

    @property
    def sec(self) -> int: ...
    @property
    def nanosec(self) -> int: ...


# An int is nanoseconds.
TimeLike = HasNanoseconds | HasSecNanosec | int | np.datetime64

# Many times; an array holds integer nanoseconds, or datetime64.
TimesLike = npt.ArrayLike | Sequence[TimeLike]

# A tolerance, an interval, how far a history reaches back.
DurationLike = HasNanoseconds | HasSecNanosec

# How long to wait; a number is seconds.
TimeoutLike = HasNanoseconds | HasSecNanosec | float
