"""Count what each listener has received by topic, for errors, warnings and representations."""

import itertools
import os
import time
import weakref
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.subscription import Subscription

from tf2_py import BufferCore
from tf2_py._internal import counted
from tf2_ros._forking import LiveObjects
from tf2_ros._rclpy import context_was_shut_down, enter_handle
from tf2_ros._receive.receiver import Receiver

# A topic of dynamic transforms is called silent if nothing was received on it for this long. Most are sent
# ten times a second or more.
SILENT_S = 3

_receptions: "LiveObjects[Reception]" = LiveObjects()


class ReceivedTopic:
    """
    What was received on one subscription of a listener.

    :param is_counted: whether :meth:`received` counts every message, because the listener's own methods
        handle them.
    """

    def __init__(self, subscription: Subscription, is_static: bool, is_counted: bool) -> None:
        self.name = subscription.topic_name
        self.is_static = is_static
        self.is_counted = is_counted
        self._subscription = weakref.ref(subscription)
        # Several threads of an executor may count.
        self._counter = itertools.count(1)
        self._called = 0
        self._called_at_ns = 0
        self.receiver: Receiver | None = None  # counts what it takes from the subscription

    def count_call(self) -> None:
        """Count a message with which an executor has called the listener."""
        self._called = next(self._counter)
        self._called_at_ns = time.monotonic_ns()

    def received(self) -> tuple[int, int]:
        """Return how many messages there were, and the steady time of the last one in nanoseconds."""
        taken, taken_at_ns = (0, 0) if self.receiver is None else self.receiver.received(self.is_static)
        return taken + self._called, max(taken_at_ns, self._called_at_ns)

    def is_open(self) -> bool:
        """Whether the subscription still exists."""
        subscription = self._subscription()
        with ExitStack() as uses:
            return subscription is not None and enter_handle(subscription.handle, uses)

    def is_left_to_executors(self) -> bool:
        """Whether no receiver takes its messages."""
        return self.receiver is None or self.receiver.is_left_to_executors(self.is_static)

    def describe(self) -> str:
        """Describe its name, how many messages there were, when the last one was, and what takes them."""
        count, last_ns = self.received()
        if count == 0 and not self.is_counted:
            facts = "messages not counted"
        else:
            facts = counted(count, "message")
            if count:
                facts += f", last {(time.monotonic_ns() - last_ns) / 1e9:.2f} s ago"
        is_left = self.is_left_to_executors()
        if not self.is_open() or not (is_left or self.receiver is None or self.receiver.alive):
            facts += ", ended"
        elif is_left:
            facts += ", taken by an executor"
        return f"{self.name}: {facts}"


class Reception:
    """
    What a listener has received. It exists as long as the listener refers to it.

    :param listener: has the attributes ``buffer`` and ``node``.
    :param topics: of its subscriptions.
    """

    def __init__(self, listener: Any, topics: Sequence[ReceivedTopic]) -> None:
        self.topics = list(topics)
        self._listener = weakref.ref(listener)
        node = listener.node
        self._context = node.context if isinstance(node, Node) else None
        self._domain = None if self._context is None else self._context.get_domain_id()
        self._node_name = node.get_fully_qualified_name() if isinstance(node, Node) else "?"
        self._warned_of: weakref.WeakSet[Reception] = weakref.WeakSet()  # they fill the same buffer, or did
        _receptions.add(self)
        self.fill(listener.buffer)

    def fill(self, buffer: object) -> None:
        """Note the buffer that it fills from now on; warn if another one does so from the same topics."""
        if isinstance(buffer, BufferCore):
            BufferCore._ask_for_silence(buffer, _silence)
        others = [one for one in _receptions_of(buffer) if one is not self and one._domain == self._domain]
        # More than two listeners get no further warning.
        shared = [
            (topic.name, doubles[0])
            for topic in self.topics
            if len(doubles := [one for one in others if one._receives_on(topic.name)]) == 1
            and doubles[0] not in self._warned_of
        ]
        if shared:
            for _, other in shared:
                self._warned_of.add(other)
                other._warned_of.add(self)
            names = _joined([name for name, _ in shared])
            nodes = _joined(sorted({self._node_name, *(other._node_name for _, other in shared)}))
            filled = f"one {type(buffer).__name__} (at {id(buffer):#x})"
            get_logger("tf2_ros").warning(
                f"Two listeners of {nodes} fill {filled} from {names}: one is enough"
            )

    def fills(self, buffer: object) -> bool:
        """Whether the transforms are for this buffer."""
        listener = self._listener()
        return listener is not None and listener.__dict__.get("buffer") is buffer

    def names(self) -> str:
        """The topics."""
        return ", ".join(topic.name for topic in self.topics)

    def describe(self) -> str:
        """What was received on each topic."""
        return "; ".join(topic.describe() for topic in self.topics)

    def receiving(self) -> list[ReceivedTopic]:
        """The topics that it can receive anything on."""
        if self._context is not None and context_was_shut_down(self._context):
            return []
        return [topic for topic in self.topics if topic.is_open()]

    def _receives_on(self, name: str) -> bool:
        return any(topic.name == name for topic in self.receiving())


def _receptions_of(buffer: object) -> list[Reception]:
    return [reception for reception in _receptions if reception.fills(buffer)]


def _silence(buffer: object) -> tuple[str, str]:
    # What BufferCore._ask_for_silence expects.
    topics = [topic for one in _receptions_of(buffer) for topic in one.receiving() if topic.is_counted]
    return _silent(topics), _silent([topic for topic in topics if not topic.is_static])


def _silent(topics: Sequence[ReceivedTopic]) -> str:
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
