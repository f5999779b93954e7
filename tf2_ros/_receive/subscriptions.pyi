from typing import Any

from tf2_ros._receive.inbox import Source
from tf2_ros.records import Recording

class TopicArrivals:
    def count(self) -> None: ...
    def taken(self) -> tuple[int, int]: ...

class Subscriptions(Source):
    is_told: bool
    def __new__(
        cls, recording: Recording | None = None, clock: object = None, prefix: str = ""
    ) -> Subscriptions: ...
    def subscribe(
        self, topic: TopicArrivals, handle: Any, name: str, is_static: bool, depth: int
    ) -> None: ...
    def unsubscribe(self, topic: TopicArrivals) -> None: ...
