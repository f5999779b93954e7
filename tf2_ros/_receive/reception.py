"""Say what each listener has received by topic, for errors, warnings and representations."""

import os
import time
import weakref
from collections.abc import Sequence
from typing import Any

from rclpy.node import Node

from tf2_py import BufferCore
from tf2_ros._forking import LiveObjects
from tf2_ros._rclpy import context_was_shut_down
from tf2_ros._receive.topics import Topic

# A topic of dynamic transforms is called silent if nothing was received on it for this long. Most are sent
# ten times a second or more.
SILENT_S = 3

_receptions: "LiveObjects[Reception]" = LiveObjects()


class Reception:
    """
    What a listener has received. It exists as long as the listener refers to it.

    :param listener: has the attributes ``buffer`` and ``node``.
    :param topics: of its subscriptions.
    """

    def __init__(self, listener: Any, topics: Sequence[Topic]) -> None:
        self.topics = list(topics)
        self._listener = weakref.ref(listener)
        node = listener.node
        self._context = node.context if isinstance(node, Node) else None
        self.domain = None if self._context is None else self._context.get_domain_id()
        _receptions.add(self)
        self.fill(listener.buffer)

    def fill(self, buffer: object) -> None:
        """Note the buffer that it fills from now on."""
        if isinstance(buffer, BufferCore):
            BufferCore._ask_for_silence(buffer, _silence)
        sharing = getattr(buffer, "_tf2_sharing", None)
        if sharing is not None:
            sharing._tf2_check()  # readers learn at once that a listener fills it

    def fills(self, buffer: object) -> bool:
        """Whether the transforms are for this buffer."""
        listener = self._listener()
        return listener is not None and getattr(listener, "buffer", None) is buffer

    def names(self) -> str:
        """The topics."""
        return ", ".join(topic.name for topic in self.topics)

    def describe(self) -> str:
        """What was received on each topic."""
        return "; ".join(topic.describe() for topic in self.topics)

    def receiving(self) -> list[Topic]:
        """The topics that it can receive anything on."""
        if self._context is not None and context_was_shut_down(self._context):
            return []
        return [topic for topic in self.topics if topic.is_open()]


def receptions_of(buffer: object) -> list[Reception]:
    """What the listeners that fill a buffer have received."""
    return [reception for reception in _receptions if reception.fills(buffer)]


def _silence(buffer: object) -> tuple[str, str]:
    # What BufferCore._ask_for_silence expects.
    topics = [topic for one in receptions_of(buffer) for topic in one.receiving() if topic.is_counted]
    return _silent(topics), _silent([topic for topic in topics if not topic.is_static])


def _silent(topics: Sequence[Topic]) -> str:
    """Describe the silent ones of these topics in a clause without commas; ``""`` if there are none."""
    # Several listeners may receive on one topic.
    lasts: dict[str, int] = {}
    static = {topic.name for topic in topics if topic.is_static}
    for topic in topics:
        lasts[topic.name] = max(lasts.get(topic.name, 0), topic.received()[1])
    now_ns = time.monotonic_ns()
    never = [name for name, last_ns in lasts.items() if last_ns == 0]
    parts = [f"on {_joined(never)}"] if never else []
    for name, last_ns in lasts.items():
        silent_s = (now_ns - last_ns) // 10**9
        # Static transforms are sent once.
        if last_ns and silent_s >= SILENT_S and name not in static:
            parts.append(f"on {name} for {silent_s} s")
    return "nothing has been received " + " and nothing ".join(parts) if parts else ""


def _joined(names: Sequence[str]) -> str:
    return " and ".join(names)


# A forked child receives nothing through its parent's listeners, and may make its own for the same buffers.
os.register_at_fork(after_in_child=_receptions.clear)
