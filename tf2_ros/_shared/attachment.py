"""Fill buffers, and stand in for their listeners, from the ring of the process that owns a name."""

import os
import threading
import traceback
import weakref
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any

from tf2_py._internal import log
from tf2_ros._forking import is_inherited
from tf2_ros._receive.inbox import Inbox
from tf2_ros._receive.inboxes import AUTHORITY, THREAD_END_WAIT_S, add_owner, check_regularly, threads
from tf2_ros._shared.files import Description, describe_owner, is_owned, open_file
from tf2_ros._shared.naming import VARIABLE, SharedBufferError, buffer_name, is_wanted
from tf2_ros._shared.owner import Owner
from tf2_ros._shared.ring import RingReader
from tf2_ros_cython._presence import HAS_ROS

if TYPE_CHECKING or HAS_ROS:
    from rclpy.logging import get_logger
    from rclpy.node import Node

    from tf2_ros._rcl import problem
    from tf2_ros._rclpy import context_was_shut_down, has_tasks
    from tf2_ros._wait.callbacks import CallbackQueue, callback_queue, hand_over, queue_of
    from tf2_ros._wait.rounds import Ending

__all__ = ["AttachedListener", "Attachment", "Ring", "attach_listener", "open_ring"]


class Ring:
    """
    The ring of one owner, which fills a buffer through an inbox.

    :param descriptor: of its file; it is closed with this object.
    :param name: of the shared buffer.
    """

    def __init__(self, descriptor: int, name: str) -> None:
        reference: weakref.ref[Ring] = weakref.ref(self)
        self.reader = RingReader(descriptor, partial(_begin, reference))
        self.inbox = Inbox(self.reader, AUTHORITY, partial(_hand_over, reference))
        self.name = name
        found = self.describe_owner()
        self.process = 0 if found is None else found.process
        self._threads: list[threading.Thread] = []
        self._buffer: weakref.ref[Any] | None = None

    def describe_owner(self) -> Description | None:
        """Read the owner's description; None if it cannot be read."""
        return describe_owner(self.reader.descriptor)

    def cache_time_s(self) -> float:
        """For how long the owner keeps transforms; 10 s if its description cannot be read."""
        found = self.describe_owner()
        return 10.0 if found is None else max(0, found.cache_time_ns) / 1e9

    def attach_to(self, buffer: Any) -> "Attachment":
        """Fill a buffer, as long as it exists."""
        return Attachment(buffer, self)

    def fill(self, buffer: Any) -> None:
        """Fill a buffer from now on."""
        self._buffer = weakref.ref(buffer)
        self.inbox.fill(buffer)
        add_owner(self)
        if self.reader.is_wanted:
            self.begin()

    def begin(self) -> None:
        """Have a thread follow the ring, because something looks or waits."""
        # At the end of the interpreter, no thread can be started; reads see everything nevertheless.
        with suppress(RuntimeError):
            threads.start_reports()
            thread = threading.Thread(
                target=self.reader.follow, args=(self.inbox,), name="tf2_ros ring", daemon=True
            )
            # One may still be ending.
            self._threads = [*(one for one in self._threads if one.is_alive()), thread]
            thread.start()

    def why_over(self) -> str | None:
        """Why nothing arrives any more; None while messages may arrive."""
        if self.reader.problem is not None:
            return self.reader.problem
        return None if is_owned(self.reader.descriptor) else f"process {self.process} has ended"

    def buffer(self) -> Any:
        """The buffer that it fills, if it exists."""
        return None if self._buffer is None else self._buffer()

    def stop(self) -> None:
        """End for good."""
        self.reader.stop()
        for thread in self._threads:
            if thread.is_alive() and thread is not threading.current_thread():
                thread.join(THREAD_END_WAIT_S)

    def end(self) -> None:
        """Insert what has arrived, and receive nothing more."""
        self.inbox.catch_up()
        self.inbox.close()
        self.stop()


def _begin(reference: "weakref.ref[Ring]") -> None:
    ring = reference()
    if ring is not None:
        ring.begin()


def _hand_over(reference: "weakref.ref[Ring]", calls: "list[Ending]") -> None:
    # Puts these into the queue that runs the callbacks of the buffer.
    ring = reference()
    buffer = None if ring is None else ring.buffer()
    if HAS_ROS and buffer is not None:
        hand_over(calls, queue_of(buffer))
        return
    for call in calls:
        try:
            call()
        except Exception:
            log.logger("tf2_ros").error(f"In a callback: {traceback.format_exc()}")


class Attachment:
    """
    Fills a buffer from the ring of the process that owns a name.

    :param buffer: not kept alive.
    :param ring: of the owner.
    :param is_by_environment: whether the environment variable attached the buffer, and not the program. Then
        its listeners subscribe when the owner ends. Otherwise the next owner of the name fills the buffer.
    """

    def __init__(self, buffer: Any, ring: Ring, is_by_environment: bool = False) -> None:
        self.name = ring.name
        self.is_by_environment = is_by_environment
        self.ring: Ring | None = ring
        self.listeners: list[AttachedListener] = []
        self.changing = threading.RLock()  # held while it or one of its listeners changes
        self._buffer = weakref.ref(buffer)
        self._process = os.getpid()
        ring.fill(buffer)
        check_regularly(self)

    @property
    def is_attached(self) -> bool:
        """Whether an owner fills the buffer in this process."""
        return self.ring is not None and not self.is_inherited()

    def is_inherited(self) -> bool:
        """Whether it is dead, because a parent process made it."""
        return is_inherited(self._process)

    def buffer(self) -> Any:
        """The buffer, if it exists."""
        return self._buffer()

    def _tf2_check(self) -> None:
        """Find out whether the owner has ended, or look for the next one."""
        with self.changing:
            buffer, ring = self._buffer(), self.ring
            if buffer is None:
                self.close()
            elif ring is None:
                self._find_owner(buffer)
            elif why := ring.why_over() or self._lack(ring):
                self._lose(ring, why)

    def close(self) -> None:
        """End; the buffer keeps what it holds."""
        if self.is_inherited():
            return
        with self.changing:
            ring, self.ring = self.ring, None
        if ring is not None:
            ring.end()

    def _lack(self, ring: Ring) -> str:
        return next(filter(None, (listener.lack(ring) for listener in list(self.listeners))), "")

    def _lose(self, ring: Ring, why: str) -> None:
        self.ring = None
        ring.end()
        log.logger("tf2_ros").info(f"The shared buffer {self.name!r} is not filled any more: {why}")
        if self.is_by_environment:
            for listener in list(self.listeners):
                listener.leave(why)

    def _find_owner(self, buffer: Any) -> None:
        if self.is_by_environment:
            return
        try:
            self.ring = ring = open_ring(self.name)
        except SharedBufferError:
            return  # the next `check` tries again
        ring.fill(buffer)
        log.logger("tf2_ros").info(f"The shared buffer {self.name!r} is process {ring.process}'s now")
        for listener in list(self.listeners):
            listener.inform()


def open_ring(name: str) -> Ring:
    """
    Open a shared buffer.

    :raises SharedBufferError: there is no buffer of this name, or it cannot be read.
    """
    descriptor = open_file(name)
    try:
        return Ring(descriptor, name)
    except (OSError, ValueError) as error:
        raise SharedBufferError(f"cannot attach to the shared buffer {name!r}: {error}") from None


class AttachedListener:
    """
    What a listener has instead of subscriptions.

    :param listener: has ``buffer`` and ``node``, which keeps it alive until :meth:`close`. When another
        process fills its buffer no more, its ``_tf2_listen_itself()`` makes its subscriptions.
    :param attachment: of its buffer.
    :param topics: those that it would subscribe to.
    """

    def __init__(self, listener: Any, attachment: Attachment, topics: Sequence[str]) -> None:
        self.topics = tuple(topics)
        self._listener = weakref.ref(listener)
        self._attachment = attachment
        self._ended = False
        self._queue: CallbackQueue | None = None
        self._kept: Any = None
        attachment.listeners.append(self)
        if problem() is None:
            self._kept = listener  # by the node, as a listener is by its subscriptions
            self._queue = callback_queue(listener.node)
            self._queue.inform(self._before_sleep)
            self.inform()

    @property
    def alive(self) -> bool:
        """Whether transforms come from another process now."""
        return not self._ended and self._attachment.is_attached

    def describe(self) -> str:
        """Where transforms come from."""
        ring = self._attachment.ring
        process = "" if ring is None else f" of process {ring.process}"
        return f"the shared buffer {self._attachment.name!r}{process}"

    def redirect(self) -> None:
        """Let the listener subscribe on its own if it fills another buffer by now."""
        listener = self._listener()
        if listener is not None and listener.buffer is not self._attachment.buffer():
            self.leave("this program gives the listener another buffer")

    def lack(self, ring: Ring) -> str:
        """Why a ring cannot replace the subscriptions; ``""`` if it can, or if the program has chosen it."""
        listener, buffer = self._listener(), self._attachment.buffer()
        if not self._attachment.is_by_environment or listener is None or buffer is None:
            return ""
        why = _lack(ring, buffer, listener.node, self.topics)
        return f"it {why}" if why else ""

    def leave(self, reason: str) -> None:
        """Subscribe, for good."""
        attachment, listener = self._attachment, self._listener()
        with attachment.changing:
            if self._ended:
                return
            self.close()
            buffer = attachment.buffer()
            if attachment.is_by_environment and not attachment.listeners:
                attachment.close()
                if buffer is not None and buffer._tf2_sharing is attachment:
                    buffer._tf2_sharing = None
            if listener is not None and not context_was_shut_down(listener.node.context):
                leaves = f"leaves the shared buffer {attachment.name!r}: {reason}"
                _log(listener.node, f"subscribes on its own from now on, and {leaves}")
                listener._tf2_listen_itself()

    def close(self) -> None:
        """End, and no longer keep the listener alive."""
        self._ended = True
        self._kept = None
        if self in self._attachment.listeners:
            self._attachment.listeners.remove(self)
        if self._queue is not None:
            self._queue.inform_no_more(self._before_sleep)
            ring = self._attachment.ring
            if ring is not None:
                ring.inbox.inform(None)
        for other in self._attachment.listeners:
            other.inform()

    def inform(self) -> None:
        """Have the executor of the listener's node informed of what arrives."""
        ring = self._attachment.ring
        if ring is not None and self._queue is not None:
            ring.inbox.inform(self._queue)

    def _before_sleep(self, in_user_code: bool) -> None:
        ring, listener = self._attachment.ring, self._listener()
        if ring is None or listener is None or self._queue is None or self._ended:
            return
        if in_user_code:
            ring.inbox.catch_up()  # this informs the executor, and wakes it for what arrives later
            return
        polls = self._queue.in_sets and has_tasks(listener.node.executor)
        ring.reader.set_pace(polls)
        if not polls:
            self._queue.sleep_on()


def attach_listener(listener: Any, is_usual: bool, topics: Sequence[str]) -> AttachedListener | None:
    """
    Let a listener use what another process receives, if its buffer is attached or the environment asks to.

    :param is_usual: whether it receives what any listener does, and its buffer gets that unchanged.
    :param topics: those that it would subscribe to.
    :return: None if the listener must subscribe on its own.
    """
    buffer: Any = listener.buffer
    node: Any = listener.node
    if not isinstance(node, Node):
        return None
    sharing = buffer._tf2_sharing
    if isinstance(sharing, Owner):
        resolved = [node.resolve_topic_name(name) for name in topics]
        sharing.add_listener(listener, node.context.get_domain_id(), resolved)
        return None
    if sharing is None or sharing.is_inherited():
        sharing = _by_environment(buffer, node, is_usual, topics)
    if sharing is None:
        return None
    return AttachedListener(listener, sharing, topics)


def _by_environment(buffer: Any, node: "Node", is_usual: bool, topics: Sequence[str]) -> Attachment | None:
    """Attach a buffer as the environment asks, if that can replace this listener's subscriptions."""
    if not is_wanted():
        return None
    try:
        name = buffer_name(os.environ[VARIABLE], node)
        if not is_usual:
            raise SharedBufferError("it, or its buffer, is of another kind than tf2's")
        if (why := problem()) is not None:
            raise SharedBufferError(f"nothing is received here: {why}")
        if buffer._tf2_names():
            raise SharedBufferError("its buffer holds frames already")
        ring = open_ring(name)
        if lack := _lack(ring, buffer, node, topics):
            raise SharedBufferError(f"the shared buffer {name!r} {lack}")
    except (SharedBufferError, ValueError) as reason:
        _log(node, f"subscribes on its own: {reason}")
        return None
    buffer._tf2_sharing = found = Attachment(buffer, ring, is_by_environment=True)
    _log_use(node, ring)
    return found


def _log_use(node: "Node", ring: Ring) -> None:
    _log(node, f"uses the shared buffer {ring.name!r} of process {ring.process}, and subscribes to nothing")


def _log(node: "Node", what: str) -> None:
    get_logger("tf2_ros").info(f"A listener of {node.get_fully_qualified_name()} {what}")


def _lack(ring: Ring, buffer: Any, node: "Node", topics: Sequence[str]) -> str:
    """Why what an owner shares cannot replace subscriptions; ``""`` if it can."""
    owner: Description | None = ring.describe_owner()
    if owner is None or owner.domain is None:
        return "has no listener"
    domain = node.context.get_domain_id()
    if owner.domain != domain:
        return f"is filled from ROS domain {owner.domain}, this is {domain}"
    missing = [name for name in map(node.resolve_topic_name, topics) if name not in owner.topics]
    if missing:
        return f"is not filled from {' and '.join(missing)}"
    cache_time_ns: int = buffer._tf2_cache_time_ns
    if owner.cache_time_ns < cache_time_ns:
        return f"keeps {owner.cache_time_ns / 1e9:g} s, this one {cache_time_ns / 1e9:g} s"
    short_ns, missed = ring.reader.shortage
    if 0 < short_ns < cache_time_ns:
        return f"has memory for {short_ns / 1e9:.3g} s, this one keeps {cache_time_ns / 1e9:g} s"
    if missed:
        return "has no memory for all messages"
    clock: Any = node.get_clock()
    if clock.ros_time_is_active and not owner.simulated:
        return "does not follow simulated time"
    return ""
