# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Checks that all targets share, and the class of a fault."""

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np

from tf2_py import BufferCore, TransformException


class Fault(AssertionError):
    """What must not be."""


def holds_the_same(a: BufferCore, b: BufferCore) -> bool:
    """Whether the images of two buffers are the same, to the last bit."""
    return np.array_equal(a.__getstate__()["image"], b.__getstate__()["image"])


def answers(buffer: BufferCore, most: int = 6) -> None:
    """Check a buffer, before and after :func:`ask`."""
    buffer._self_check()
    ask(buffer, most)
    buffer._self_check()


def ask(buffer: BufferCore, most: int) -> None:
    """Ask a buffer everything about so many of its frames: it answers, or says what is missing."""
    known = buffer._getFrameStrings()[:most]
    frames = buffer.frames()
    for name, other in itertools.permutations(known, 2):
        times = {0, max(frames[name].newest_ns or 0, 0), max(frames[other].oldest_ns or 0, 0)}
        _look_up(buffer.lookup_transforms, name, other, [*times, 1, 2**60], on_missing="nan")
        for time_ns in times:
            _look_up(buffer.lookup_transform_core, name, other, time_ns)
    buffer.all_frames_as_yaml()
    buffer.all_frames_as_string()
    buffer._allFramesAsDot(1)
    buffer.tree()
    buffer.statistics()
    repr(buffer)


def _look_up(call: Callable[..., Any], *arguments: Any, **options: Any) -> None:
    try:
        call(*arguments, **options)
    except TransformException:
        pass
    except OverflowError as error:
        if "does not fit into the stamp" not in str(error):
            raise
