# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Types of times, durations and a lookup's policy, for the signatures of this project and of programs."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import timedelta
from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol, TypedDict, Union

import numpy as np
import numpy.typing as npt

__all__ = [
    "DurationLike",
    "DurationsLike",
    "HasNanoseconds",
    "HasSecNanosec",
    "LookupPolicy",
    "TimeLike",
    "TimesLike",
]

if TYPE_CHECKING:
    from typing_extensions import Self as Self
    from typing_extensions import TypeVarTuple as TypeVarTuple
    from typing_extensions import Unpack as Unpack
else:

    def _newer(name: str, otherwise: Any) -> Any:
        """A name that not every ``typing`` has; else that of ``typing_extensions``, if it is installed."""
        for module in ("typing", "typing_extensions"):
            with suppress(ImportError, AttributeError):
                return getattr(import_module(module), name)
        return otherwise

    # Without them, hints are less exact.
    Self = _newer("Self", Any)
    TypeVarTuple = _newer("TypeVarTuple", lambda name: Any)
    Unpack = _newer("Unpack", Union)  # of one type, which is that type
    TypeAliasType = _newer("TypeAliasType", lambda name, value: value)


class HasNanoseconds(Protocol):
    """An rclpy ``Time`` or ``Duration``, or anything with their ``nanoseconds``."""

    @property
    def nanoseconds(self) -> int: ...


class HasSecNanosec(Protocol):
    """A ``builtin_interfaces/Time`` or ``Duration``, or anything with their fields."""

    @property
    def sec(self) -> int: ...
    @property
    def nanosec(self) -> int: ...


#: A time: an rclpy ``Time``, a time message, any object with the same attributes, an ``int`` in
#: nanoseconds, or a NumPy ``datetime64`` or pandas ``Timestamp``, which are UTC.
TimeLike = HasNanoseconds | HasSecNanosec | int | np.datetime64

#: Many times: an array of integers in nanoseconds or of ``datetime64``, or a sequence of times.
TimesLike = npt.ArrayLike | Sequence[TimeLike]

#: A duration, such as a timeout, a tolerance or the length of a history: an rclpy ``Duration``, a duration
#: message, any object with the same attributes, a ``timedelta``, or a number of seconds.
DurationLike = HasNanoseconds | HasSecNanosec | timedelta | float

#: One duration for all frames, or a mapping from frame names to durations.
DurationsLike = DurationLike | Mapping[str, DurationLike]

if not TYPE_CHECKING:  # signatures then show the names, not what these stand for
    TimeLike = TypeAliasType("TimeLike", TimeLike)
    TimesLike = TypeAliasType("TimesLike", TimesLike)
    DurationLike = TypeAliasType("DurationLike", DurationLike)
    DurationsLike = TypeAliasType("DurationsLike", DurationsLike)


class LookupPolicy(TypedDict, total=False):
    """
    Options of lookups that tf2 does not have: keyword arguments of ``tf2_ros.Buffer.lookup_transform`` and
    others.

    ``tolerance``: a duration, or a mapping of frames to durations. A frame whose newest sample is at most
    this much older than the requested time stays at that sample. Frames that are not in a mapping must have
    data. The answer has the stamp of the oldest such sample. However, ``transform`` and ``transform_async``
    keep the stamp of the data, and ``transform_full`` uses the target time.

    ``extrapolate``: with a tolerance, such a frame continues at the velocity of its last two samples instead,
    and the stamp of the answer is the requested time.

    ``max_gap``: a duration. There is no answer between two samples that are further apart.

    ``max_age``: a duration, or a mapping of frames to durations, for lookups at the latest time, 0. There is
    no answer while the newest sample of a moving frame on the path is older than this, on the clock of the
    buffer; a lookup with a timeout keeps waiting. Static frames have no age, and frames that are
    not in a mapping may have any age. Any other time raises a ``ValueError``, and so does a
    buffer without a clock, such as a ``BufferCore`` or the buffer of a recording.

    The frames of a mapping are children: the limit of ``base_link`` applies to the transform from its parent.
    A frame that is unknown or has no parent is a ``ValueError`` if the buffer has a path between the two
    frames of the lookup.
    """

    tolerance: DurationsLike | None
    extrapolate: bool
    max_gap: DurationLike | None
    max_age: DurationsLike | None
