from typing import Any

from tf2_py import BufferCore
from tf2_ros._receive.inbox import MessageInbox
from tf2_ros.records import Recording

class RclInbox(MessageInbox):
    def set_up(
        self, authority: str, rounds: Any, recording: Recording | None = None, prefix: str = ""
    ) -> None: ...
    def subscribe(
        self,
        number: int,
        handle: object,
        subscription: int,
        name: str,
        is_static: bool,
        depth: int,
    ) -> None: ...
    def unsubscribe(self, number: int, is_told: bool = True) -> None: ...
    def fill(self, buffer: BufferCore, clock: int = 0) -> None: ...
    def taken(self, number: int) -> tuple[int, int]: ...
