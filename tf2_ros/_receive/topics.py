"""The topics of listeners: what was received on them, for errors, warnings and representations."""

import os
import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from tf2_py import BufferCore
from tf2_py._internal import counted
from tf2_ros._forking import LiveObjects
from tf2_ros._nodes import note_filler
from tf2_ros._rclpy import context_was_shut_down, enter_handle
from tf2_ros._receive.subscriptions import TopicArrivals

# A topic of dynamic transforms is called silent if nothing was received on it for this long. Most are sent
# ten times a second or more.
SILENT_S = 3


class Topic:
    """
    A topic of a listener.

    :param attribute: of the listener, for the subscription.
    :param method: of the listener, that is called with each message if an executor takes it.
    :param name: to subscribe to; from then on, that of the subscription.
    :param qos: what the program has chosen, or None.
    """

    def __init__(
        self, attribute: str, method: str, name: str, qos: QoSProfile | int | None, *, is_static: bool
    ) -> None:
        self.attribute, self.method, self.name, self.qos = attribute, method, name, qos
        self.is_static = is_static
        self.is_own = True  # whether the method is TransformListener's, so that `arrivals` counts all
        self.subscription: Subscription | None = None  # of rclpy's class or a subclass
        self.context: Any = None  # of the subscription
        self.arrivals = TopicArrivals()

    def is_open(self) -> bool:
        """Whether anything can be received on it."""
        if self.subscription is None or context_was_shut_down(self.context):
            return False
        with ExitStack() as uses:
            return enter_handle(self.subscription.handle, uses)

    def describe(self) -> str:
        """Describe its name, how many messages there were, and when the last one was."""
        count, last_ns = self.arrivals.taken()
        facts = counted(count, "message") if count or self.is_own else "messages not counted"
        if count:
            facts += f", last {(time.monotonic_ns() - last_ns) / 1e9:.2f} s ago"
        return f"{self.name}: {facts}" if self.is_open() else f"{self.name}: {facts}, ended"


_listeners: LiveObjects[Any] = LiveObjects()  # of the class TransformListener


def note_listener(listener: Any) -> None:
    """Note that a TransformListener fills its buffer from now on."""
    buffer = listener.buffer
    _listeners.add(listener)
    # A subclass that does not call __init__ may not have a node yet.
    note_filler(getattr(listener, "node", None), buffer, listener._tf2_queue)
    if isinstance(buffer, BufferCore):
        BufferCore._ask_for_silence(buffer, _silence)
    sharing = getattr(buffer, "_tf2_sharing", None)
    if sharing is not None:
        sharing._tf2_check()  # readers learn at once that a listener fills it


def open_topics(buffer: object) -> list[Topic]:
    """The topics on which the listeners of a buffer can receive anything."""
    listeners = [one for one in _listeners if getattr(one, "buffer", None) is buffer]
    return [topic for listener in listeners for topic in listener._tf2_topics if topic.is_open()]


def _silence(buffer: object) -> tuple[str, str]:
    # What BufferCore._ask_for_silence expects.
    topics = [topic for topic in open_topics(buffer) if topic.is_own]
    return _silent(topics), _silent([topic for topic in topics if not topic.is_static])


def _silent(topics: Sequence[Topic]) -> str:
    """Describe the silent ones of these topics in a clause without commas; ``""`` if there are none."""
    # Several listeners may receive on one topic.
    lasts: dict[str, int] = {}
    for topic in topics:
        lasts[topic.name] = max(lasts.get(topic.name, 0), topic.arrivals.taken()[1])
    static = {topic.name for topic in topics if topic.is_static}
    parts = []
    for name, last_ns in lasts.items():
        silent_s = (time.monotonic_ns() - last_ns) // 10**9
        if last_ns == 0:
            parts.append(f"on {name}")
        elif silent_s >= SILENT_S and name not in static:  # static transforms are sent once
            parts.append(f"on {name} for {silent_s} s")
    return "nothing has been received " + " and ".join(parts) if parts else ""


# A forked child receives nothing through its parent's listeners, and may make its own for the same buffers.
os.register_at_fork(after_in_child=_listeners.clear)
