"""Owns what a process does whose buffer is another process's: its thread, and what it passes on."""

import atexit
import os
import threading
import time
import traceback
import weakref
from collections.abc import Callable
from typing import Any

from tf2_py._internal import log
from tf2_ros._forking import LOCK
from tf2_ros._shared.description import Description, read_description
from tf2_ros._shared.names import SharedBufferError, segment_path
from tf2_ros._shared.segment import FollowedSegment, OwnedSegment

__all__ = ["Follower", "attach", "open_segment"]

# How often the loop of an executor has a round where transforms arrive: with tasks that poll, and without.
ROUND_S, IDLE_ROUND_S = 0.1, 2.0
IDLE_S = 5.0  # so long nothing waits, and the thread ends
END_WAIT_S = 1.0
AWAITED = 2  # as `BufferCore._follow` returns it

_following: "weakref.WeakSet[Follower]" = weakref.WeakSet()


class Follower:
    """
    Passes on what another process inserts: to waits, message filters and executors.

    :param buffer: which is attached to ``segment``; not kept alive.
    :param name: of the shared buffer.

    Its thread runs while something waits, and all the time where :meth:`notify` was called: it also finds out
    that the owner has died. Then, and when the buffer has left, it calls what was given to :meth:`notify`.
    """

    def __init__(self, buffer: Any, segment: FollowedSegment | OwnedSegment, name: str) -> None:
        self.name = name
        self._segment = segment
        known = self.description()
        # In another container it has another id, or none.
        self.process = segment.owner or (known.process if known is not None else 0)
        self._buffer = weakref.ref(buffer)
        self._listeners: list[tuple[Callable[[], None], Callable[[str], None]]] = []
        self._hand_over: Callable[[list[Callable[[], None]]], object] = _call_all
        self._thread: threading.Thread | None = None
        self._stopping = False
        self._round_s = IDLE_ROUND_S
        self.is_by_environment = False  # whether the program does not know of it
        buffer._when_waiting(_weakly(self))
        _following.add(self)

    @property
    def alive(self) -> bool:
        """Whether the buffer is still attached, in a process that is not a forked child of its own."""
        buffer = self._buffer()
        return buffer is not None and buffer._is_attached

    def description(self) -> Description | None:
        """What the owner tells of itself; None: nothing that can be read."""
        return read_description(self._segment.description())

    def clears_at_jumps(self, clock: Any) -> bool:
        """Whether the owner clears the buffer when this clock jumps: its time is simulated as this is."""
        known = self.description() if self.alive else None
        return known is not None and known.simulated == bool(clock.ros_time_is_active)

    def notify(
        self,
        changed: Callable[[], None],
        left: Callable[[str], None],
        hand_over: Callable[[list[Callable[[], None]]], object],
    ) -> None:
        """
        Call ``changed`` when something was inserted, and ``left``, once, when the buffer has left.

        :param left: gets the reason.
        :param hand_over: has a list of callables called, which run user code.
        """
        with LOCK:
            self._listeners.append((changed, left))
            self._hand_over = hand_over
        self.follow()

    def follow(self) -> None:
        """Something waits: have the thread run."""
        with LOCK:
            if self._stopping or (self._thread is not None and self._thread.is_alive()):
                return
            self._thread = threading.Thread(target=self._run, name="tf2_ros follower", daemon=True)
        self._thread.start()

    def set_pace(self, busy: bool) -> None:
        """Whether the loop of an executor has tasks that poll."""
        pace = ROUND_S if busy else IDLE_ROUND_S
        if pace != self._round_s:
            self._round_s = pace
            buffer = self._buffer()
            if buffer is not None:
                buffer._interrupt_following()

    def stop(self) -> None:
        """End the thread."""
        self._stopping = True
        buffer, thread = self._buffer(), self._thread
        if buffer is not None:
            buffer._interrupt_following()
        if thread is not None and thread is not threading.current_thread() and thread.is_alive():
            thread.join(END_WAIT_S)

    def _run(self) -> None:
        waited_at = time.monotonic()
        while not self._stopping:
            buffer = self._buffer()
            if buffer is None:
                break
            if self._listeners or buffer._is_waited_for:
                waited_at = time.monotonic()
            elif time.monotonic() - waited_at > IDLE_S and self._end(buffer):
                break
            if not self._pass_on(buffer):
                break
            del buffer

    def _end(self, buffer: Any) -> bool:
        with LOCK:
            if self._listeners or buffer._is_waited_for:
                return False
            self._thread = None
            return True

    def _pass_on(self, buffer: Any) -> bool:
        """Pass on what happens next; False: the buffer is no longer attached."""
        later: list[Callable[[], None]] = []
        happened = 0
        until = time.monotonic() + self._round_s
        try:
            happened = buffer._follow(self._round_s, later)
        except Exception:
            log.logger("tf2_ros").error(f"In what waits for transforms: {traceback.format_exc()}")
        attached = bool(buffer._is_attached)
        if not attached:
            # If another thread made it leave just now, it brought changes of which no waiter knows yet.
            buffer._follow(0.0, later)
            self._leave(buffer)
        if later:
            self._hand_over(later)
        if attached and (happened == AWAITED or (happened and time.monotonic() >= until)):
            for tell, _ in list(self._listeners):
                tell()
        return attached

    def _leave(self, buffer: Any) -> None:
        with LOCK:
            listeners, self._listeners = self._listeners, []
        reason = buffer._why_left or (
            "this program changes its buffer"
            if self._segment.is_alive
            else f"process {self.process} has ended"
        )
        for _, left in listeners:
            try:
                left(reason)
            except Exception:
                log.logger("tf2_ros").error(f"After leaving {self.name!r}: {traceback.format_exc()}")


def open_segment(name: str) -> FollowedSegment:
    """
    Open a shared buffer.

    :raises SharedBufferError: there is none of this name, or it cannot be read.
    """
    try:
        return FollowedSegment(segment_path(name))
    except FileNotFoundError:
        raise SharedBufferError(f"no process of this user shares a buffer {name!r}") from None
    except (OSError, ValueError) as error:
        raise SharedBufferError(f"the shared buffer {name!r} cannot be read: {error}") from None


def attach(buffer: Any, segment: FollowedSegment, name: str) -> Follower:
    """
    Attach a buffer without frames to a shared one.

    :raises SharedBufferError: one of the two does not permit it.
    """
    try:
        segment.attach(buffer)
    except ValueError as error:
        raise SharedBufferError(f"cannot attach to the shared buffer {name!r}: {error}") from None
    return Follower(buffer, segment, name)


def _weakly(follower: Follower) -> Callable[[], None]:
    reference = weakref.ref(follower)

    def follow() -> None:
        found = reference()
        if found is not None:
            found.follow()

    return follow


def _call_all(completions: list[Callable[[], Any]]) -> None:
    for completion in completions:
        try:
            completion()
        except Exception:
            log.logger("tf2_ros").error(f"In a callback of a future: {traceback.format_exc()}")


@atexit.register
def _stop_all() -> None:
    for follower in list(_following):
        follower.stop()


def _after_fork_in_child() -> None:
    # Listeners are the parent's; waits of the child begin threads of their own.
    for follower in list(_following):
        follower._thread = None
        follower._listeners.clear()
        follower._hand_over = _call_all


os.register_at_fork(after_in_child=_after_fork_in_child)
