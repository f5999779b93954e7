from collections.abc import Callable, Iterable, Sequence
from typing import Any

from geometry_msgs.msg import TransformStamped

from tf2_py import BufferCore
from tf2_ros._receive.recording import Recording

__all__ = ["Explained", "Source", "fill", "read_transforms"]

class Explained:
    def __new__(
        cls,
        messages: Iterable[tuple[Any, int, bytes | memoryview]],
        explain: Callable[[Exception, int | None], Exception | None],
        least: int = ...,
    ) -> Explained: ...
    def __iter__(self) -> Explained: ...
    def __next__(self) -> tuple[Any, int, bytes | memoryview]: ...

class Source:
    topic: str
    def __new__(cls, topic: str, is_static: bool, prefix: str = ...) -> Source: ...

def fill(
    buffer: BufferCore,
    messages: Iterable[tuple[Any, int, bytes | memoryview]],
    sources: Sequence[Source],
    skip: Callable[[str, int, ValueError], object],
    *,
    count: Callable[[int], object] | None = ...,
    recording: Recording | None = ...,
    records: list[Any] | None = ...,
) -> int: ...
def read_transforms(raw: bytes | memoryview, source: Source) -> list[TransformStamped]: ...
