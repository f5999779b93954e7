from collections.abc import Callable
from enum import Enum
from typing import Any

from tf2_ros._wait.completions import Completions
from tf2_ros._wait.endings import Ending

PASSED: str
CLEARED: str

class FilterCalls:
    callbacks: dict[int, tuple[Callable[..., object], tuple[Any, ...]]]
    failure_callbacks: dict[int, tuple[Callable[..., object], tuple[Any, ...], bool]]
    waiting: dict[QueuedMessage, None]
    dropped_in_a_row: int
    def __init__(self, reasons: type[Enum]) -> None: ...
    def wants_text(self) -> bool: ...
    def oldest(self) -> QueuedMessage | None: ...
    def add_stream(self, stream: Any) -> None: ...
    def streams(self) -> list[Any]: ...
    def statistics(self) -> Any: ...

class QueuedMessage(Ending):
    message: Any
    frame: str
    stamp_ns: int
    def __init__(
        self,
        calls: FilterCalls,
        completions: Completions,
        message: Any,
        frame: str,
        stamp_ns: int,
        outcome: Callable[[QueuedMessage, Any], tuple[Any, str | None]],
        warn: Callable[[QueuedMessage, Any], None],
    ) -> None: ...
    def answered(self, answer: Any) -> Ending | None: ...
    def waits_for(self, wait: Any) -> None: ...
    def expire(self) -> None: ...
