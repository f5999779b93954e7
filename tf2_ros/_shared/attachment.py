"""Owns what a listener has instead of subscriptions where its buffer is another process's."""

import threading
import weakref
from collections.abc import Sequence
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.logging import get_logger
from rclpy.node import Node

from tf2_py import BufferCore
from tf2_ros._rclpy import context_was_shut_down, has_tasks
from tf2_ros._receive.arrivals import Arrivals, Completion
from tf2_ros._receive.callback_thread import callback_thread
from tf2_ros._receive.rcl import problem
from tf2_ros._receive.receiver_thread import add_filler, can_receive
from tf2_ros._shared.description import Description, read_description
from tf2_ros._shared.following import Follower, attach, open_segment
from tf2_ros._shared.names import SharedBufferError, wanted_name
from tf2_ros._shared.owning import Owner

__all__ = ["Attachment", "attach_listener", "detach_listener"]

QUEUE_DEPTH = 100  # of a listener's subscription: more messages an executor would not have found there


class Attachment:
    """
    What a listener has instead of subscriptions.

    :param listener: with ``buffer``, ``node``, ``group``; when the buffer is no longer attached, its
        ``_listen_itself()`` is called. The node keeps it alive, until :meth:`close`.
    :param follower: of its buffer.
    """

    def __init__(self, listener: Any, follower: Follower) -> None:
        self._listener = weakref.ref(listener)
        self._buffer = weakref.ref(listener.buffer)
        self._node = weakref.ref(listener.node)
        self._ended = False
        self._leaving = threading.RLock()
        self.follower = follower
        self.arrivals: _Changes | None = None
        if can_receive() and isinstance(listener.node, Node):
            self.arrivals = arrivals = _Changes(listener, self._buffer, follower)
            listener.node.add_waitable(arrivals)
            add_filler(self)
        follower.notify(self._changed, self._left, self.hand_over)

    @property
    def alive(self) -> bool:
        """Whether the buffer is still attached, and this listener has not ended."""
        return not self._ended and self.follower.alive

    def describe(self) -> str:
        """Where transforms come from."""
        return f"the shared buffer {self.follower.name!r} of process {self.follower.process}"

    def fills(self, buffer: BufferCore) -> bool:
        """Whether it is this buffer's."""
        return self.arrivals is not None and not self._ended and self._buffer() is buffer

    def decide_again(self) -> None:
        """The program may have redirected what is received: then the listener listens itself."""
        listener, buffer = self._listener(), self._buffer()
        if self._ended or listener is None:
            return
        if listener.__dict__.get("buffer") is not buffer:
            self._left("this program gives the listener another buffer")
        elif buffer is not None and not listener._is_direct():
            buffer._leave()

    def use_subscriptions(self) -> None:
        """The program wants the subscriptions: if it did not attach the buffer, the listener makes them."""
        buffer = self._buffer()
        if buffer is None or not self.follower.is_by_environment:
            return
        with self._leaving:
            if not self._ended:
                self._left("this program uses the listener's subscriptions")
                buffer._leave()

    def reinsert_recent(self, until_ns: int) -> None:
        """Nothing was inserted here."""

    def stop(self) -> None:
        """The follower has a thread, not this."""

    def after_fork(self) -> bool:
        """End in a forked child, where the buffer is still attached; nothing is lost."""
        self._ended = True
        if self.arrivals is not None:
            self.arrivals.after_fork()
        return False

    def close(self) -> None:
        """End, and do not keep the listener alive any more."""
        self._ended = True
        if self.arrivals is not None:
            self.arrivals.close()
            self.arrivals.listener = None

    def _changed(self) -> None:
        if self.arrivals is not None and not self._ended:
            self.arrivals.count(0)

    def hand_over(self, completions: list[Completion]) -> None:
        """Have them called in the executor of the listener's node, or in a thread for callbacks."""
        if self.arrivals is not None and not self._ended:
            self.arrivals.hand_over(completions)
        else:
            for completion in completions:
                callback_thread.put(completion)

    def _left(self, reason: str) -> None:
        # In the thread of the follower, or of the program, which then finds the subscriptions.
        with self._leaving:
            listener, node, ended = self._listener(), self._node(), self._ended
            if ended:
                return
            self.close()
            if listener is None or node is None or context_was_shut_down(node.context):
                return
            get_logger("tf2_ros").info(
                f"A listener of {node.get_fully_qualified_name()} listens itself from now on, and leaves the "
                f"shared buffer {self.follower.name!r}: {reason}"
            )
            listener._listen_itself()


class _Changes(Arrivals):
    """Tells an executor, as a receiver would of messages, that something has changed in another process."""

    def __init__(self, listener: Any, buffer: "weakref.ref[Any]", follower: Follower) -> None:
        group: CallbackGroup = listener.group
        super().__init__(listener.node, group, [QUEUE_DEPTH])
        self.listener = listener  # which the node keeps alive by this, as by its subscriptions
        self._attached = buffer
        self._follower = follower

    def before_sleep(self, in_user_code: bool) -> None:
        """Have the executor woken as often as messages would wake it, where somebody can tell."""
        buffer, node = self._attached(), self._node()
        if buffer is None or node is None or not buffer._is_attached:
            return
        if in_user_code:
            # `spin_once` must come back when something changes, also if it just has.
            if not buffer._expect():
                self.count(0)
        else:
            self._follower.set_pace(has_tasks(node.executor))


def attach_listener(listener: Any, is_usual: bool, topics: Sequence[str]) -> Attachment | None:
    """
    Let a listener use the buffer of another process, where its own is attached, or the environment wants it.

    :param is_usual: whether it receives what any listener does, and its buffer gets that unchanged.
    :param topics: that it would subscribe to.
    :return: None: it must listen itself.
    """
    buffer: Any = listener.buffer
    node: Any = listener.node
    if not hasattr(buffer, "_sharing") or not isinstance(node, Node):
        return None
    sharing = buffer._sharing
    if isinstance(sharing, Owner):
        resolved = [node.resolve_topic_name(name) for name in topics]
        sharing.tell_of_listener(listener, node.context.get_domain_id(), resolved)
        clock: Any = node.get_clock()
        sharing.tell_of_time(clock.ros_time_is_active)
        return None
    if sharing is None:
        sharing = _by_environment(buffer, node, is_usual, topics)
    if sharing is None or not sharing.alive:
        return None
    return Attachment(listener, sharing)


def detach_listener(listener: Any) -> None:
    """The listener ends: nobody is to rely on what it receives."""
    sharing = getattr(listener.__dict__.get("buffer"), "_sharing", None)
    if isinstance(sharing, Owner):
        sharing.tell_of_listener(listener, 0, [])


def _by_environment(buffer: Any, node: Node, is_usual: bool, topics: Sequence[str]) -> Follower | None:
    """The follower of the buffer that the environment names, if that can replace this listener's work."""
    domain = node.context.get_domain_id()
    name = None
    try:
        name = wanted_name(domain)
        if name is None:
            return None
        if not is_usual:
            raise SharedBufferError("it, or its buffer, is of another kind than tf2's")
        if not can_receive():
            raise SharedBufferError(f"nothing is received here: {problem()}")
        if buffer._known_names():
            raise SharedBufferError("its buffer holds frames already")
        segment = open_segment(name)
        lack = _lack(read_description(segment.description()), buffer, node, domain, topics)
        if lack:
            raise SharedBufferError(f"the shared buffer {name!r} {lack}")
        buffer._sharing = attach(buffer, segment, name)
        buffer._sharing.is_by_environment = True
    except (SharedBufferError, ValueError) as reason:
        get_logger("tf2_ros").info(
            f"A listener of {node.get_fully_qualified_name()} listens itself: {reason}"
        )
        return None
    get_logger("tf2_ros").info(
        f"A listener of {node.get_fully_qualified_name()} uses the shared buffer {name!r} of process "
        f"{buffer._sharing.process}, and subscribes to nothing"
    )
    found: Follower = buffer._sharing
    return found


def _lack(owner: Description | None, buffer: Any, node: Node, domain: int, topics: Sequence[str]) -> str:
    """Why an owner's buffer cannot stand for that of a listener; ``""``: it can."""
    if owner is None or owner.domain is None:
        return "has no listener"
    if owner.domain != domain:
        return f"is filled from ROS domain {owner.domain}, this is {domain}"
    missing = [name for name in map(node.resolve_topic_name, topics) if name not in owner.topics]
    if missing:
        return f"is not filled from {' and '.join(missing)}"
    if owner.cache_time_ns < buffer.cache_time_ns:
        return f"keeps {owner.cache_time_ns / 1e9:g} s, this one {buffer.cache_time_ns / 1e9:g} s"
    clock: Any = node.get_clock()
    if clock.ros_time_is_active and not owner.simulated:
        return "does not follow simulated time"
    return ""
