"""Fuzz the parser of serialised TFMessage at as many messages per second as possible."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reliability.fuzz.faults import Fault
from reliability.fuzz.targets import cdr_ros
from tf2_py import BufferCore
from tf2_ros.records import MessageSource, read_transforms

_SOURCE = MessageSource("/tf", False)
_untouched = BufferCore()


def run(data: bytes) -> None:
    """Read a message into a buffer, which holds it then, or nothing."""
    # Of its exact size: a sanitizer sees what is read behind it.
    exact = np.frombuffer(data, np.uint8).copy()
    try:
        count = len(read_transforms(exact, _SOURCE))
    except ValueError:
        _check_refused(exact)
        return
    core = BufferCore()
    taken = core.set_transforms_cdr(exact, "fuzz", len(data) > 3 and data[3] & 1 == 1)
    core._self_check()
    if core.statistics()["taken"] != taken or taken > count:
        raise Fault(f"{taken} of {count} transforms taken, {core.statistics()}")


def _check_refused(exact: NDArray[Any]) -> None:
    # None of these buffers ever holds anything; a new one would take most of the time.
    try:
        _untouched.set_transforms_cdr(exact, "fuzz")
    except ValueError:
        if _untouched._getFrameStrings():
            raise Fault("a malformed message has changed the buffer") from None
        _untouched._self_check()
        return
    raise Fault("set_transforms_cdr takes what read_transforms refuses")


def seeds() -> Iterator[bytes]:
    """Valid messages of either byte order."""
    return cdr_ros.seeds()
