from collections.abc import Callable, Sequence

from tf2_py import BufferCore
from tf2_ros._receive.arrival_waitable import ArrivalWaitable
from tf2_ros._receive.recording import Recording

class Receiver:
    def __new__(
        cls,
        buffer: BufferCore,
        authority: str,
        arrivals: ArrivalWaitable,
        hand_over: Callable[[list[Callable[[], None]]], bool],
        recording: Recording | None = None,
    ) -> Receiver: ...
    def watch(self, types: Sequence[type]) -> None: ...
    def decide_again(self) -> None: ...
    def fills(self, buffer: BufferCore) -> bool: ...
    def reinsert_recent(self, until_ns: int) -> None: ...
    def run(
        self, context: int, guard: int, clock: int, sources: Sequence[tuple[int, int, int, str, bool]]
    ) -> list[int] | None: ...
