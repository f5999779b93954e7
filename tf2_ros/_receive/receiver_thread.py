"""Owns the thread that takes what arrives on a listener's subscriptions, beside all executors."""

import atexit
import logging
import os
import threading
import time
import traceback
import weakref
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any, Protocol

from rclpy.clock import ROSClock
from rclpy.guard_condition import GuardCondition
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.subscription import Subscription

from tf2_py import BufferCore
from tf2_ros._forking import keep_for_ever
from tf2_ros._rclpy import enter_handle, handle_pointer
from tf2_ros._receive.arrivals import Arrivals, Completion, queue_depth
from tf2_ros._receive.callback_thread import callback_thread
from tf2_ros._receive.loop import Receiver
from tf2_ros._receive.rcl import problem
from tf2_ros._receive.recording import Recording
from tf2_ros._receive.source import Source
from tf2_ros._receive.subscriptions import ListenerGroup, ReceivedSubscription, wake_executor

__all__ = [
    "Filler",
    "ReceiverThread",
    "add_filler",
    "attribute_changed",
    "can_receive",
    "hand_over",
    "reinsert_recent",
]

END_WAIT_S = 5.0  # how long to wait for the thread to end; only a very busy machine needs so long
RETRY_S = 0.5  # how long to pause after an error of rcl


class Filler(Protocol):
    """What fills buffers beside executors."""

    def hand_over(self, completions: list[Completion]) -> object: ...
    def fills(self, buffer: BufferCore) -> bool: ...
    def decide_again(self) -> None: ...
    def reinsert_recent(self, until_ns: int) -> None: ...
    def stop(self) -> None: ...
    def after_fork(self) -> bool: ...


_running: "weakref.WeakSet[Filler]" = weakref.WeakSet()


def add_filler(filler: Filler) -> None:
    """From now on, what is asked below of all that fill buffers is asked of this, too."""
    _running.add(filler)


def can_receive() -> bool:
    """Whether the receiver knows the rcl that runs."""
    return problem() is None


def attribute_changed() -> None:
    """Have every receiver decide anew where messages go, before it takes another one."""
    for thread in list(_running):
        thread.decide_again()


def reinsert_recent(buffer: BufferCore, until_ns: int) -> None:
    """
    Insert again what receivers took since the buffer's clock last moved forward.

    :param until_ns: the clock's time after its jump; what is stamped later is not inserted.
    """
    for thread in list(_running):
        if thread.fills(buffer):
            thread.reinsert_recent(until_ns)


def hand_over(buffer: BufferCore, completion: Completion) -> None:
    """Call this in the executor of a listener of the buffer, or in a thread for callbacks; not here."""
    for thread in list(_running):
        if thread.fills(buffer):
            thread.hand_over([completion])
            return
    callback_thread.put(completion)


class ReceiverThread:
    """
    Takes what arrives on subscriptions into a buffer, in a thread of its own.

    :param node: the node whose executor is informed.
    :param group: the callback group of the subscriptions.
    :param subscriptions: at most two, each with whether its transforms are static; all of class Subscription.
    :param choose: given one of these pairs, the buffer that gets its messages without Python; None where
        Python must see them: the subscription is then left to executors for good. It must refer to neither
        node nor buffer.
    :param types: the types whose attributes ``choose`` reads. For attributes of objects there is
        :meth:`decide_again`.
    :param recording: notes who sent each transform and when; or None.

    The thread ends with :meth:`stop`, with the last of the subscriptions, with the context and with the
    interpreter; a forked child has none. It keeps alive neither the buffer nor the node, and runs no user
    code.
    """

    def __init__(
        self,
        node: Node,
        authority: str,
        group: ListenerGroup,
        subscriptions: Sequence[tuple[Subscription, bool]],
        choose: Callable[[Subscription, bool], BufferCore | None],
        types: Callable[[], Sequence[type]],
        recording: Recording | None = None,
    ) -> None:
        self._node = weakref.ref(node)
        self._authority = authority
        self._choose = choose
        self._types = types
        self._recording = recording
        self._context = node.context.handle
        self._guard = GuardCondition(None, None, node.context)
        self.arrivals = Arrivals(
            node, group, [queue_depth(subscription) for subscription, _ in subscriptions]
        )
        self._sources = [
            Source(number, subscription, is_static, self._subscription_collected)
            for number, (subscription, is_static) in enumerate(subscriptions)
        ]
        self._receiver: Any = None
        self._stopping = False
        self._ended = False
        self.forked = False  # whether the thread is that of a parent process
        # A daemon, so that the interpreter does not wait for it before it runs the exit handlers.
        self._thread = threading.Thread(target=self._run, name="tf2_ros receiver", daemon=True)
        for subscription, _ in subscriptions:
            ReceivedSubscription.adopt(subscription, node, self)
        group.decide()
        node.context.on_shutdown(self._context_ended)  # referred to weakly there
        node.add_waitable(self.arrivals)
        add_filler(self)
        self._thread.start()

    @property
    def alive(self) -> bool:
        """Whether it still takes messages."""
        return not self.forked and self._thread.is_alive()

    def hand_over(self, completions: list[Completion]) -> bool:
        """See :meth:`Arrivals.hand_over`."""
        return self.arrivals.hand_over(completions)

    def fills(self, buffer: BufferCore) -> bool:
        """Whether the transforms are inserted into this buffer."""
        return self._receiver is not None and self._receiver.fills(buffer)

    def taken_from(self, subscription: Subscription) -> Callable[[], tuple[int, int]] | None:
        """What tells how many messages of a subscription it took, and when; None: it does not take them."""
        for source in self._sources:
            if source.handle is subscription.handle:
                return partial(self.arrivals.taken, source.number)
        return None

    def decide_again(self) -> None:
        """Ask ``choose`` and ``types`` again before the next message is taken."""
        if self._receiver is not None:
            self._receiver.decide_again()
        self._wake(wait=False)

    def reinsert_recent(self, until_ns: int) -> None:
        """See the function of this name."""
        self._receiver.reinsert_recent(until_ns)

    def stop(self, *, wait: bool = True) -> None:
        """
        End the thread.

        :param wait: until it has ended, unless this is that thread.
        """
        wait = wait and not self._stopping
        self._stopping = True
        self._wake(wait)

    def after_fork(self) -> bool:
        """End in a forked child, without touching the middleware; whether the parent's still works."""
        self.forked = True
        # The thread of the parent may have been using them.
        keep_for_ever(self._guard.handle, self._receiver, *self._sources)
        self.arrivals.after_fork()
        return not self._ended

    def drop_subscription(self, subscription: Subscription) -> None:
        """Take no more from this subscription."""
        if self.forked:
            return
        for source in self._sources:
            if source.handle is subscription.handle:
                source.destroy()
                self.arrivals.stop_counting(source.number)
        self._sources = [source for source in self._sources if source.handle is not subscription.handle]
        if not self._sources:
            self.arrivals.close()
        self._wake(wait=not self._sources and not self._stopping)

    def _wake(self, wait: bool) -> None:
        if self.forked:
            return
        self._guard.trigger()
        if wait and self._thread is not threading.current_thread():
            self._thread.join(END_WAIT_S)

    def _subscription_collected(self, _: Any) -> None:
        # Nobody destroyed it: its node was dropped.
        self.decide_again()

    def _context_ended(self) -> None:
        # The context is locked meanwhile.
        self.stop(wait=False)

    def _run(self) -> None:
        while not self._stopping:
            try:
                if not self._receive():
                    break
            except Exception:
                get_logger("tf2_ros").error(f"No transforms for {RETRY_S} s: {traceback.format_exc()}")
                time.sleep(RETRY_S)
        self._ended = True

    def _receive(self) -> bool:
        """Receive until something changes; whether there is more to receive."""
        with ExitStack() as uses:
            clock = _clock_pointer(self._choose_buffer(), uses)
            sources = [source for source in self._sources if source.use(uses)]
            if not sources or not enter_handle(self._context, uses):
                return False
            uses.enter_context(self._guard.handle)
            happened = self._receiver.run(
                handle_pointer(self._context),
                handle_pointer(self._guard.handle),
                clock,
                [source.as_tuple() for source in sources],
            )
            if happened is None:
                return False
            for source in sources:
                source.report_event(happened)
            return True

    def _choose_buffer(self) -> BufferCore | None:
        """Choose the buffer, and give back the subscriptions whose messages Python must see."""
        while True:
            found = (self._chosen(source) for source in self._sources)
            buffer = next((one for one in found if one is not None), None)
            if buffer is not None:
                if not self.fills(buffer):
                    self._receiver = Receiver(
                        buffer, self._authority, self.arrivals, self.arrivals.hand_over, self._recording
                    )
                # From here on a change is noticed, so what is found now remains true.
                self._receiver.watch(self._types())
            chosen = [(source, self._chosen(source)) for source in self._sources]
            if all(one is None or one is buffer for _, one in chosen):
                for source, one in chosen:
                    if one is None:
                        self._give_back(source)
                return buffer

    def _chosen(self, source: Source) -> BufferCore | None:
        subscription = source.subscription()
        return None if subscription is None else self._choose(subscription, source.is_static)

    def _give_back(self, source: Source) -> None:
        subscription: Any = source.subscription()
        if subscription is None:
            self._sources.remove(source)
            source.destroy()
        else:
            node = self._node()
            self.drop_subscription(subscription)
            subscription.give_back(node)
            wake_executor(node)


def _clock_pointer(buffer: BufferCore | None, uses: ExitStack) -> int:
    """The address of a buffer's clock that may be simulated, valid while ``uses`` is open; otherwise 0."""
    clock = getattr(buffer, "clock", None)
    if not isinstance(clock, ROSClock) or not enter_handle(clock.handle, uses):
        return 0
    return handle_pointer(clock.handle)


@atexit.register
def _stop_all() -> None:
    for thread in list(_running):
        thread.stop()


def _after_fork_in_child() -> None:
    lost = sum([thread.after_fork() for thread in list(_running)])
    _running.clear()
    if lost:
        # Not through ROS, whose locks another thread may have held.
        logging.getLogger("tf2_ros").warning(
            f"Process {os.getpid()} is a fork of one with {lost} TransformListener(s), which receive nothing "
            "here. Spawn the process instead of forking it, and make its own listeners."
        )


os.register_at_fork(after_in_child=_after_fork_in_child)
