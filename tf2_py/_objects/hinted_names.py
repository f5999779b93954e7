# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Provide what the hints of compiled methods name; most of it takes long to import."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tf2_py._objects.explanations import Explanation
from tf2_py._objects.listings import FrameInfo, History
from tf2_py._objects.message_classes import TransformStamped
from tf2_py.typing import DurationLike, LookupPolicy, TimeLike, TimesLike, Unpack

try:
    from rclpy.time import Time
except ModuleNotFoundError:
    from tf2_py._objects.message_classes import Time

__all__ = [
    "Any",
    "Callable",
    "DurationLike",
    "Explanation",
    "FrameInfo",
    "History",
    "Iterable",
    "Literal",
    "LookupPolicy",
    "NDArray",
    "Sequence",
    "Time",
    "TimeLike",
    "TimesLike",
    "TransformStamped",
    "Unpack",
    "np",
]
