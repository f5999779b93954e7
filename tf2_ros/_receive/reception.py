"""Owns what each listener has received by topic, and what errors and warnings say of it."""

import itertools
import os
import time
import weakref
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Any

from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.subscription import Subscription

from tf2_py import BufferCore
from tf2_py._internal import counted
from tf2_ros._rclpy import context_was_shut_down, enter_handle
from tf2_ros._receive.receiver_thread import ReceiverThread
from tf2_ros._wait.contexts import fills

__all__ = ["ReceivedTopic", "Reception"]

# A topic of dynamic transforms on which nothing has been received for so long is called silent. Most are
# sent ten times a second or more.
SILENT_S = 3

# By their addresses. A dict, for a WeakSet cannot be listed while another thread adds to it.
_receptions: "dict[int, weakref.ref[Reception]]" = {}


class ReceivedTopic:
    """
    What was received on one subscription of a listener.

    :param is_counted: given the subscription and ``is_static``, whether every message is counted: whether the
        listener's own methods handle them, and no code of a program. It must not refer to the listener.
    """

    def __init__(
        self, subscription: Subscription, is_static: bool, is_counted: Callable[[Subscription, bool], bool]
    ) -> None:
        self.name = subscription.topic_name
        self.is_static = is_static
        self._is_counted = is_counted
        self._subscription = weakref.ref(subscription)
        # Several threads of an executor may count.
        self._counter = itertools.count(1)
        self._called = 0
        self._called_at_ns = 0
        self._taken: Callable[[], tuple[int, int]] = _nothing

    def count_taken(self, thread: ReceiverThread) -> None:
        """Count also what a receiver's thread takes, if it takes from this subscription."""
        subscription = self._subscription()
        if subscription is not None:
            self._taken = thread.taken_from(subscription) or _nothing

    def count_call(self) -> None:
        """An executor has called the listener with a message."""
        self._called = next(self._counter)
        self._called_at_ns = time.monotonic_ns()

    def received(self) -> tuple[int, int]:
        """How many messages, and the steady time of the last one in nanoseconds."""
        taken, taken_at_ns = self._taken()
        return taken + self._called, max(taken_at_ns, self._called_at_ns)

    def is_counted(self) -> bool:
        """Whether :meth:`received` counts every message."""
        subscription = self._subscription()
        return subscription is not None and self._is_counted(subscription, self.is_static)

    def is_open(self) -> bool:
        """Whether the subscription still exists."""
        subscription = self._subscription()
        if subscription is None:
            return False
        with ExitStack() as uses:
            return enter_handle(subscription.handle, uses)

    def is_left_to_executors(self) -> bool:
        """Whether no receiver's thread takes its messages."""
        return getattr(self._subscription(), "tf2_receiver_thread", None) is None


class Reception:
    """
    What a listener has received, as long as the listener refers to this.

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
        self._warned_of: weakref.WeakSet[Reception] = weakref.WeakSet()  # that fill, or filled, the same
        address, forget = id(self), _receptions.pop
        _receptions[address] = weakref.ref(self, lambda _: forget(address, None))
        self.fill(listener.buffer)

    def fill(self, buffer: object) -> None:
        """The listener fills this buffer from now on: warn if another one does, too, from the same topics."""
        if (listener := self._listener()) is not None:
            fills(listener.node, buffer)
        if isinstance(buffer, BufferCore):
            BufferCore._ask_for_silence(buffer, _silence)
        others = [one for one in _receptions_of(buffer) if one is not self and one._domain == self._domain]
        # Of more listeners than two nothing else is to be said.
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

    def is_open(self) -> bool:
        """Whether any of its subscriptions still exists."""
        return any(topic.is_open() for topic in self.topics)

    def is_left_to_executors(self) -> bool:
        """Whether no receiver's thread takes any of its messages."""
        return all(topic.is_left_to_executors() for topic in self.topics)

    def fills(self, buffer: object) -> bool:
        """Whether the transforms are for this buffer."""
        listener = self._listener()
        return listener is not None and listener.__dict__.get("buffer") is buffer

    def describe(self) -> str:
        """The topics, how many messages there were, and when the last one was."""
        names = ", ".join(topic.name for topic in self.topics)
        facts = [topic.received() for topic in self.topics]
        count, last_ns = sum(number for number, _ in facts), max((at_ns for _, at_ns in facts), default=0)
        if count == 0 and not all(topic.is_counted() for topic in self.topics):
            return f"{names}: messages not counted"
        last = f", last {(time.monotonic_ns() - last_ns) / 1e9:.2f} s ago" if count else ""
        return f"{names}: {counted(count, 'message')}{last}"

    def receiving(self) -> list[ReceivedTopic]:
        """The topics that it can receive anything on."""
        if self._context is not None and context_was_shut_down(self._context):
            return []
        return [topic for topic in self.topics if topic.is_open()]

    def _receives_on(self, name: str) -> bool:
        return any(topic.name == name for topic in self.receiving())


def _receptions_of(buffer: object) -> list[Reception]:
    existing = (reference() for reference in list(_receptions.values()))
    return [reception for reception in existing if reception is not None and reception.fills(buffer)]


def _silence(buffer: object) -> tuple[str, str]:
    # As BufferCore._ask_for_silence wants it.
    topics = [topic for one in _receptions_of(buffer) for topic in one.receiving() if topic.is_counted()]
    return _silent(topics), _silent([topic for topic in topics if not topic.is_static])


def _silent(topics: Sequence[ReceivedTopic]) -> str:
    """Which of these topics are silent, as a clause without commas; ``""``: none."""
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


def _nothing() -> tuple[int, int]:
    return 0, 0


def _joined(names: Sequence[str]) -> str:
    return " and ".join(names)


# A forked child receives nothing by its parent's listeners, and may make its own for the same buffers.
os.register_at_fork(after_in_child=_receptions.clear)
