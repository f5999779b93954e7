"""Fill buffers, and replace the subscriptions of their listeners, from the ring of the owner of a name."""

import os
import threading
import time
import weakref
from collections.abc import Sequence
from contextlib import nullcontext
from functools import partial
from typing import Any

from rclpy.logging import get_logger

from tf2_py._internal import log
from tf2_py.printable import counted
from tf2_ros._forking import LOCK, is_inherited
from tf2_ros._node_lifetimes import node_has_ended
from tf2_ros._rcl import problem
from tf2_ros._rclpy import is_node, is_simulated
from tf2_ros._receive.inbox import Informed
from tf2_ros._receive.listener_topics import LOSS_WARNING_S, Topic
from tf2_ros._shared.owner import is_owned, opened, read_description
from tf2_ros._shared.ring import PolledInbox, RingReader
from tf2_ros._shared.shared_names import VARIABLE, SharedBufferError, buffer_name, is_wanted, segment_path
from tf2_ros._threads import THREAD_END_WAIT_S, add_owner, call_logged, start
from tf2_ros._wait.call_runners import hand_over_for


def open_ring(name: str) -> RingReader:
    """
    Open a shared buffer.

    :raises SharedBufferError: there is no buffer of this name, or it cannot be read.
    """
    try:
        with opened(segment_path(name)) as descriptor:
            if is_owned(descriptor):
                return RingReader(os.dup(descriptor))
    except FileNotFoundError:
        pass
    except (OSError, ValueError) as error:
        raise SharedBufferError(f"cannot attach to the shared buffer {name!r}: {error}") from None
    raise SharedBufferError(
        f"no process of this user shares a buffer {name!r}: start one, such as tf2_shared_buffer "
        f"--name {name}"
    )


class Attachment:
    """
    Fills a buffer from the ring of the process that owns a name, until that ends: the owner of an inbox.

    :param buffer: gets this as its attachment; not kept alive.
    :param reader: of the owner's ring.

    When the owner ends, the listeners subscribe. Without listeners, the buffer keeps this until it gets
    another attachment, to the next owner of the name.
    """

    kind = "attached buffer"

    def __init__(self, buffer: Any, name: str, reader: RingReader) -> None:
        self.name, self.reader = name, reader
        self.owner = read_description(reader.descriptor).process
        self._cache_time_s = buffer.cache_time_ns / 1e9
        self._warned_of = 0  # overruns
        self._warned_at = -LOSS_WARNING_S
        self.listeners: dict[int, AttachedListener] = {}  # by the ids of the listeners
        self.buffer = weakref.ref(buffer)
        self._process = os.getpid()
        self._has_ended = False
        self.inbox = PolledInbox(reader, hand_over_for(buffer))
        self.inbox.fill(buffer)
        self._follows_no_more = threading.Event()
        try:
            # Not by `Thread.start`, which waits for the new thread, where a finalizer of the program may wait
            # for LOCK, which is held here.
            start("tf2_ros ring", _follow, self.inbox, self._follows_no_more)
        except BaseException:
            self.inbox.close()
            raise
        buffer._tf2_attachment = self
        add_owner(self)

    @property
    def is_attached(self) -> bool:
        """Whether an owner fills the buffer in this process."""
        return not self._has_ended and not is_inherited(self._process)

    def _tf2_check(self) -> None:
        """Find out whether the owner has ended; if so, replace it."""
        buffer = self.buffer()
        if buffer is None:
            self.close()
            return
        self._warn_of_overruns()
        for attached in list(self.listeners.values()):
            if node_has_ended(attached.listener.node):  # as its subscriptions would
                attached.listener_ended(waits=True)
        if not self._has_ended:
            if not is_owned(self.reader.descriptor):
                why = "no longer shares it"
            elif self.listeners and read_description(self.reader.descriptor).domain is None:
                why = "no longer has a listener"
            else:
                return
            text = f"The shared buffer {self.name!r} is no longer filled: process {self.owner} {why}"
            log.logger("tf2_ros").info(text)
            self._end()
        with LOCK:
            if buffer._tf2_attachment is not self:
                return  # it was closed, or another thread was faster
            if self.listeners:
                buffer._tf2_attachment = None
                for attached in list(self.listeners.values()):
                    leave = partial(attached.leave, f"the shared buffer {self.name!r} has ended")
                    call_logged(leave, "In a listener that subscribes")
            else:
                try:
                    found = Attachment(buffer, self.name, open_ring(self.name))
                except SharedBufferError:
                    return  # the next check tries again
                log.logger("tf2_ros").info(f"Process {found.owner} now shares the buffer {self.name!r}")

    def overruns(self) -> tuple[int, float]:
        """
        How often messages were lost that the buffer would still hold, because newer ones displaced them
        unread, and for how many seconds of messages the owner has room.
        """
        count, room_s = self.reader.overruns()
        return (count if room_s < self._cache_time_s else 0), room_s

    def _warn_of_overruns(self) -> None:
        (count, room_s), now = self.overruns(), time.monotonic()
        if count <= self._warned_of or now - self._warned_at < LOSS_WARNING_S:
            return
        times = counted(count - self._warned_of, "time")
        log.logger("tf2_ros").warning(
            f"Lost messages of the shared buffer {self.name!r} {times}: newer messages displaced them before "
            f"this process read them. The shared buffer has room for {room_s:.1f} s, but this buffer keeps "
            f"{self._cache_time_s:g} s. Make a lookup at least every {room_s:.1f} s, or give process "
            f"{self.owner} a larger /dev/shm, up to 1 GiB"
        )
        self._warned_of, self._warned_at = count, now

    def close(self) -> None:
        """Insert what has arrived, and receive nothing more; the buffer keeps what it holds."""
        if is_inherited(self._process):
            return
        buffer = self.buffer()
        with LOCK:
            if buffer is not None and buffer._tf2_attachment is self:
                buffer._tf2_attachment = None
        self._end()

    stop = close  # as an owner of an inbox

    def _end(self) -> None:
        # Several threads may do this at once, and each step again.
        self.inbox.catch_up()
        self.inbox.close()
        self._follows_no_more.wait(THREAD_END_WAIT_S)
        self._has_ended = True

    def add(self, listener: Any) -> None:  # a TransformListener
        """Replace the subscriptions of a listener of the buffer."""
        self.listeners[id(listener)] = AttachedListener(self, listener)
        runner = _runner(listener)
        if isinstance(runner, Informed):
            self.inbox.inform(runner)  # its executor returns from `spin_once` for what arrives

    def remove(self, listener: Any) -> None:
        """Undo :meth:`add`."""
        self.listeners.pop(id(listener), None)
        runner, others = _runner(listener), [_runner(one.listener) for one in self.listeners.values()]
        if isinstance(runner, Informed) and runner not in others:
            self.inbox.withdraw(runner)

    def describe(self) -> str:
        """Where transforms come from, and how often some were lost."""
        count, _ = self.overruns()
        lost = f", messages lost {counted(count, 'time')}" if count else ""
        return f"the shared buffer {self.name!r} of process {self.owner}{lost}"


def _follow(inbox: PolledInbox, has_ended: threading.Event) -> None:
    inbox.follow()
    has_ended.set()


class AttachedListener:
    """
    What a listener of an attached buffer has in place of a ``Receiver``, until one of them ends.

    It keeps the listener alive, as subscriptions do.
    """

    def __init__(self, attachment: Attachment, listener: Any) -> None:
        self._attachment, self.listener = attachment, listener
        listener._tf2_listening.receiver = self

    @property
    def topics(self) -> Sequence[Topic]:
        """The topics whose messages arrive in the buffer."""
        return self.listener._tf2_listening.topics if self._attachment.is_attached else ()

    def describe(self) -> str:
        """Where transforms come from, and how often some were lost."""
        return self._attachment.describe()

    def redirect(self, buffer: Any) -> None:
        """Let the listener subscribe if the program has given it another buffer."""
        listening = self.listener._tf2_listening
        if listening.buffer is self._attachment.buffer():
            return
        self.leave("this program gives the listener another buffer")
        if listening.receiver is not None:
            listening.receiver.redirect(buffer)  # another thread may have made it for the buffer of before

    def listener_ended(self, waits: bool) -> None:
        """
        Let the listener end, which keeps what its buffer has.

        :param waits: False in a finalizer: then all of this is garbage, and no other thread uses it.
        """
        with LOCK if waits else nullcontext():
            self._remove()

    def leave(self, reason: str) -> None:
        """Let the listener subscribe, for good."""
        listener = self.listener
        with LOCK:
            if id(listener) not in self._attachment.listeners:
                return
            try:
                if not node_has_ended(listener.node):
                    _log(listener, f"subscribes on its own from now on: {reason}")
                    listener._tf2_listen_itself()
            finally:  # last: whoever ends the listener meanwhile, or gives it a buffer, waits
                self._remove()

    def _remove(self) -> None:
        if self.listener._tf2_listening.receiver is self:
            self.listener._tf2_listening.receiver = None
        self._attachment.remove(self.listener)


def _runner(listener: Any) -> Any:
    return listener._tf2_listening.call_queue.runner


def attach_listener(listener: Any, unusual: str) -> bool:
    """
    Let a listener use what another process receives, if its buffer is attached or the environment asks to.

    :param unusual: why it does not receive what any listener does, or its buffer does not get that unchanged;
        ``""`` if it does.
    :return: False if the listener must subscribe on its own.
    """
    buffer = listener.buffer
    if not is_node(listener.node) or buffer._tf2_sharing is not None:
        return False
    with LOCK:
        found: Attachment | None = buffer._tf2_attachment
        if found is None and not is_wanted():
            return False
        try:
            if found is not None and not found.is_attached:
                raise SharedBufferError(f"the shared buffer {found.name!r} has ended")
            if unusual:
                raise SharedBufferError(unusual)
            if (why := problem()) is not None:
                raise SharedBufferError(f"nothing is received here: {why}")
            name = buffer_name(os.environ[VARIABLE], listener.node) if found is None else found.name
            reader = open_ring(name) if found is None else found.reader
            if lack := _lack(reader, buffer, listener):
                raise SharedBufferError(f"the shared buffer {name!r} {lack}")
        except (SharedBufferError, ValueError) as reason:
            _log(listener, f"subscribes on its own: {reason}")
            return False
        if found is None:
            found = Attachment(buffer, name, reader)
        found.add(listener)
        _log(listener, f"uses {found.describe()}, and subscribes to nothing")
        return True


def _log(listener: Any, what: str) -> None:
    get_logger("tf2_ros").info(f"A listener of {listener.node.get_fully_qualified_name()} {what}")


def _lack(reader: RingReader, buffer: Any, listener: Any) -> str:
    """Why what an owner shares cannot replace subscriptions; ``""`` if it can."""
    owner, node = read_description(reader.descriptor), listener.node
    if owner.domain is None:
        return "has no listener"
    domain = node.context.get_domain_id()
    if owner.domain != domain:
        return f"is filled from ROS domain {owner.domain}, but this node is in domain {domain}"
    topics = [node.resolve_topic_name(topic.name) for topic in listener._tf2_listening.topics]
    missing = [name for name in topics if name not in owner.topics]
    if missing:
        return f"is not filled from {' and '.join(missing)}"
    cache_time_ns: int = buffer.cache_time_ns
    if owner.cache_time_ns < cache_time_ns:
        return f"keeps {owner.cache_time_ns / 1e9:g} s, but this buffer keeps {cache_time_ns / 1e9:g} s"
    if is_simulated(node.get_clock()) and not owner.simulated:
        return "does not follow simulated time"
    return ""
