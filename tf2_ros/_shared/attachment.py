"""Fill buffers, and replace the subscriptions of their listeners, from the ring of the owner of a name."""

import os
import threading
import weakref
from functools import partial
from typing import TYPE_CHECKING, Any

from tf2_py._internal import log
from tf2_ros._forking import is_inherited
from tf2_ros._receive.inbox import Inbox
from tf2_ros._receive.inboxes import THREAD_END_WAIT_S, add_owner, check_regularly, start_reports
from tf2_ros._shared.files import describe_owner, is_owned, open_file
from tf2_ros._shared.naming import VARIABLE, SharedBufferError, buffer_name, is_wanted
from tf2_ros._shared.owner import Owner
from tf2_ros._shared.ring import RingReader
from tf2_ros._wait.endings import call_logged
from tf2_ros_cython._presence import HAS_ROS

if TYPE_CHECKING or HAS_ROS:
    from rclpy.logging import get_logger
    from rclpy.node import Node

    from tf2_ros._rcl import problem
    from tf2_ros._rclpy import context_was_shut_down
    from tf2_ros._wait.callbacks import hand_over, queue_of
    from tf2_ros._wait.endings import Ending


def open_ring(name: str) -> RingReader:
    """
    Open a shared buffer.

    :raises SharedBufferError: there is no buffer of this name, or it cannot be read.
    """
    descriptor = open_file(name)
    try:
        return RingReader(descriptor)
    except (OSError, ValueError) as error:
        raise SharedBufferError(f"cannot attach to the shared buffer {name!r}: {error}") from None


class Attachment:
    """
    Fills a buffer from the ring of the process that owns a name: the owner of an inbox for each such process.

    :param buffer: not kept alive.
    :param reader: of the present owner's ring.
    :param is_by_environment: whether the environment variable attached the buffer, and not the program. Then
        its listeners subscribe when the owner ends. Otherwise the next owner of the name fills the buffer.
    """

    def __init__(self, buffer: Any, name: str, reader: RingReader, is_by_environment: bool = False) -> None:
        self.name = name
        self.is_by_environment = is_by_environment
        self.listeners: dict[int, Any] = {}  # kept alive, as by subscriptions; by their ids
        self._buffer = weakref.ref(buffer)
        self._process = os.getpid()
        self._fill(buffer, reader)
        add_owner(self)
        check_regularly(self)

    def _fill(self, buffer: Any, reader: RingReader) -> None:
        self.reader = reader
        self.owner = describe_owner(reader.descriptor).process
        self.inbox = Inbox(reader, partial(_hand_over, self._buffer))
        self.inbox.fill(buffer)
        for listener in self.listeners.values():
            self._inform(listener)
        self._thread = threading.Thread(
            target=reader.follow, args=(self.inbox,), name="tf2_ros ring", daemon=True
        )
        self._thread.start()
        start_reports()
        self._is_open = True

    @property
    def is_attached(self) -> bool:
        """Whether an owner fills the buffer in this process."""
        return self._is_open and not self.is_inherited()

    def is_inherited(self) -> bool:
        """Whether it is dead, because a parent process made it."""
        return is_inherited(self._process)

    def _tf2_check(self) -> None:
        """Find out whether the owner has ended, or look for the next one."""
        buffer = self._buffer()
        if buffer is None:
            self.close()
        elif not self._is_open:
            self._find_owner(buffer)
        elif why := self._why_over(buffer):
            self.close()
            log.logger("tf2_ros").info(f"The shared buffer {self.name!r} is not filled any more: {why}")
            if self.is_by_environment:
                for listener in list(self.listeners.values()):
                    self.leave(listener, why)

    def _why_over(self, buffer: Any) -> str:
        if self.reader.problem is not None:
            return self.reader.problem
        if not is_owned(self.reader.descriptor):
            return f"process {self.owner} has ended"
        if self.is_by_environment:
            for listener in list(self.listeners.values()):
                if lack := _lack(self.reader, buffer, listener):
                    return f"it {lack}"
        return ""

    def _find_owner(self, buffer: Any) -> None:
        if self.is_by_environment:
            return
        try:
            reader = open_ring(self.name)
        except SharedBufferError:
            return  # the next check tries again
        self._fill(buffer, reader)
        log.logger("tf2_ros").info(f"The shared buffer {self.name!r} is process {self.owner}'s now")

    def close(self) -> None:
        """Insert what has arrived, and receive nothing more; the buffer keeps what it holds."""
        if self.is_attached:
            self._is_open = False
            self.inbox.catch_up()
            self.inbox.close()
            self.stop()

    def stop(self) -> None:
        """End the thread that follows the ring."""
        self.reader.stop()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(THREAD_END_WAIT_S)

    # What listeners have instead of subscriptions.

    def add(self, listener: Any) -> None:  # a TransformListener
        """Replace the subscriptions of a listener of the buffer, and keep it alive, until :meth:`remove`."""
        self.listeners[id(listener)] = listener
        queue = listener._tf2_queue
        if queue is not None:
            queue.sleepers.add(self)
        self._inform(listener)

    def remove(self, listener: Any) -> bool:
        """Undo :meth:`add`; whether it was there."""
        if self.is_inherited() or self.listeners.pop(id(listener), None) is None:
            return False
        queue = listener._tf2_queue
        if queue is not None and all(one._tf2_queue is not queue for one in self.listeners.values()):
            queue.sleepers.discard(self)
        return True

    def has(self, listener: Any) -> bool:
        """Whether a listener's transforms come from another process now."""
        return self.is_attached and id(listener) in self.listeners

    def leave(self, listener: Any, reason: str) -> None:
        """Let a listener subscribe, for good."""
        if not self.remove(listener):
            return
        buffer = self._buffer()
        if self.is_by_environment and not self.listeners:
            self.close()
            if buffer is not None and buffer._tf2_sharing is self:
                buffer._tf2_sharing = None
        listener._tf2_attachment = None
        if not context_was_shut_down(listener.node.context):
            _log(
                listener,
                f"subscribes on its own from now on, and leaves the shared buffer {self.name!r}: {reason}",
            )
            listener._tf2_listen_itself()

    def describe(self) -> str:
        """Where transforms come from."""
        return f"the shared buffer {self.name!r} of process {self.owner}"

    def _inform(self, listener: Any) -> None:
        # Its executor returns from `spin_once` for what arrives.
        if listener._tf2_queue is not None:
            self.inbox.inform(listener._tf2_queue)

    def before_sleep(self, in_user_code: bool) -> None:
        """Prepare for an executor of a listener's node that is about to sleep; see ``Sleeper``."""
        if in_user_code:
            self.inbox.catch_up()  # this informs the executor, and wakes it for what arrives later


def _hand_over(reference: "weakref.ref[Any]", calls: "list[Ending]") -> None:
    # Puts these into the queue that runs the callbacks of the buffer.
    buffer = reference()
    if HAS_ROS:
        hand_over(None if buffer is None else queue_of(buffer), calls)
        return
    for call in calls:
        call_logged(call, "In a callback")


def attach_listener(listener: Any, is_usual: bool) -> Attachment | None:
    """
    Let a listener use what another process receives, if its buffer is attached or the environment asks to.

    :param is_usual: whether it receives what any listener does, and its buffer gets that unchanged.
    :return: None if the listener must subscribe on its own.
    """
    buffer = listener.buffer
    sharing: Owner | Attachment | None = buffer._tf2_sharing
    if not isinstance(listener.node, Node) or isinstance(sharing, Owner):
        return None
    if sharing is None or sharing.is_inherited():
        sharing = _by_environment(buffer, listener, is_usual) if is_wanted() else None
    if sharing is not None:
        sharing.add(listener)
    return sharing


def _by_environment(buffer: Any, listener: Any, is_usual: bool) -> Attachment | None:
    """Attach a buffer as the environment asks, if that can replace this listener's subscriptions."""
    try:
        name = buffer_name(os.environ[VARIABLE], listener.node)
        if not is_usual:
            raise SharedBufferError("it, or its buffer, is of another kind than tf2's")
        if (why := problem()) is not None:
            raise SharedBufferError(f"nothing is received here: {why}")
        if buffer._tf2_names():
            raise SharedBufferError("its buffer holds frames already")
        reader = open_ring(name)
        if lack := _lack(reader, buffer, listener):
            raise SharedBufferError(f"the shared buffer {name!r} {lack}")
    except (SharedBufferError, ValueError) as reason:
        _log(listener, f"subscribes on its own: {reason}")
        return None
    buffer._tf2_sharing = found = Attachment(buffer, name, reader, is_by_environment=True)
    _log(listener, f"uses {found.describe()}, and subscribes to nothing")
    return found


def _log(listener: Any, what: str) -> None:
    get_logger("tf2_ros").info(f"A listener of {listener.node.get_fully_qualified_name()} {what}")


def _lack(reader: RingReader, buffer: Any, listener: Any) -> str:
    """Why what an owner shares cannot replace subscriptions; ``""`` if it can."""
    owner, node = describe_owner(reader.descriptor), listener.node
    if owner.domain is None:
        return "has no listener"
    domain = node.context.get_domain_id()
    if owner.domain != domain:
        return f"is filled from ROS domain {owner.domain}, this is {domain}"
    topics = [node.resolve_topic_name(topic.name) for topic in listener._tf2_topics]
    missing = [name for name in topics if name not in owner.topics]
    if missing:
        return f"is not filled from {' and '.join(missing)}"
    cache_time_ns: int = buffer.cache_time_ns
    if owner.cache_time_ns < cache_time_ns:
        return f"keeps {owner.cache_time_ns / 1e9:g} s, this one {cache_time_ns / 1e9:g} s"
    short_ns, missed = reader.shortage
    if 0 < short_ns < cache_time_ns:
        return f"has memory for {short_ns / 1e9:.3g} s, this one keeps {cache_time_ns / 1e9:g} s"
    if missed:
        return "has no memory for all messages"
    if node.get_clock().ros_time_is_active and not owner.simulated:
        return "does not follow simulated time"
    return ""
