from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray

from tf2_py import BufferCore

__all__ = ["RECORD", "MessageSource", "Recording", "insert_messages", "read_transforms", "refusal_text"]

RECORD: np.dtype[np.void]

class Recording:
    def __new__(cls, capacity: int = ...) -> Recording: ...
    def take(self) -> NDArray[np.void]: ...
    def frames(self) -> list[str]: ...
    def publishers(self) -> list[bytes]: ...
    def values(self) -> list[tuple[float, float, float, float, float, float, float]]: ...
    @property
    def messages(self) -> int: ...
    @property
    def malformed(self) -> int: ...
    @property
    def lost(self) -> int: ...

class MessageSource:
    topic: str
    def __new__(cls, topic: str, static: bool = ..., prefix: str = ...) -> MessageSource: ...

def insert_messages(
    buffer: BufferCore,
    messages: Iterable[tuple[Any, int, bytes | memoryview]],
    sources: Iterable[MessageSource],
    *,
    on_malformed: Callable[[str, int, ValueError], object] | None = ...,
    on_broken: Callable[[Exception, int | None], Exception] | None = ...,
    recording: Recording | None = ...,
    records: list[NDArray[np.void]] | None = ...,
    progress: Callable[[int], object] | None = ...,
) -> int: ...
def read_transforms(raw: bytes | memoryview, source: MessageSource) -> list[TransformStamped]: ...
def refusal_text(refusals: int) -> str: ...
