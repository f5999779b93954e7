# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import ArrayLike, NDArray

from tf2_py import BufferCore
from tf2_ros.records import Recording

__all__ = ["MessageSource", "insert_messages", "read_transforms", "serialize_arrays", "serialize_transforms"]

class MessageSource:
    topic: str
    def __new__(
        cls, topic: str, static: bool = False, prefix: str = "", publisher: bytes = b""
    ) -> MessageSource: ...

def insert_messages(
    buffer: BufferCore,
    messages: Iterable[tuple[Any, int, bytes | memoryview]],
    sources: Iterable[MessageSource],
    *,
    on_malformed: Callable[[str, int, ValueError], object] | None = None,
    on_broken: Callable[[Exception, int | None], Exception] | None = None,
    recording: Recording | None = None,
    records: list[NDArray[np.void]] | None = None,
    progress: Callable[[int], object] | None = None,
) -> int: ...
def read_transforms(raw: bytes | memoryview, source: MessageSource) -> list[TransformStamped]: ...
def serialize_transforms(transforms: TransformStamped | Iterable[TransformStamped]) -> bytes: ...
def serialize_arrays(
    frames: Iterable[tuple[str, str]], stamps_ns: ArrayLike, transforms: ArrayLike
) -> bytes: ...
