"""
The background threads of a process.

| thread | started by | woken by | ends |
|---|---|---|---|
| receiver | the first inbox | arrivals, see ``inbox.pyx`` | at exit |
| reports | the same, or what is checked regularly | inboxes with something to report | at exit |
| deadlines | the first timeout | an earlier deadline | one second after the last, or at exit |
| callbacks | the first callback that no executor runs | another one | at exit |

All are daemons, so that the interpreter does not wait for them before it runs the exit handlers, which end
them. A forked child has none of them, and starts its own at their first use; what its parent's inboxes were
doing is lost there. The threads that spin nodes are in ``_spinner``.
"""

import atexit
import logging
import os
import threading
import time
from _thread import start_new_thread
from collections.abc import Callable
from contextlib import suppress
from queue import SimpleQueue
from typing import Any, Protocol

from tf2_py._internal import log
from tf2_py.printable import counted
from tf2_ros._live_objects import LiveObjects
from tf2_ros._receive.inbox import INBOXES, Inbox

CHECK_S = 0.7  # between two checks, at least: an idle thread wakes every 1.5 s
THREAD_END_WAIT_S = 5.0  # how long to wait for a thread to end; only a very busy machine needs this long


def call_logged(call: Callable[[], object], where: str) -> None:
    """Call something, and log what it raises, because no caller would catch it."""
    try:
        call()
    except BaseException as error:
        log.raised(error, where)


def start(name: str, target: Callable[..., object], *arguments: object) -> None:
    """
    Start a thread; returns at once.

    :raises RuntimeError: no thread can be started.
    """
    start_new_thread(_begin, (name, target, arguments))


def _begin(name: str, target: Callable[..., object], arguments: tuple[object, ...]) -> None:
    # In a thread of its own, where no signal handler runs. `Thread.start` waits for the new thread in Python:
    # what a handler raises there surfaces as an error of a lock, or the new thread waits forever.
    try:
        threading.Thread(target=target, args=arguments, name=name, daemon=True).start()
    except (RuntimeError, MemoryError):  # this thread could be started, another one cannot
        target(*arguments)


# Those of this process that run a target of `start_once`, and the targets whose threads have not begun yet.
running: dict[Callable[..., object], threading.Thread] = {}
_starting: set[Callable[..., object]] = set()


def start_once(name: str, target: Callable[..., object], *arguments: object) -> None:
    """
    Start a thread, unless one runs this target; returns at once.

    :param target: after its end, the next use starts another thread. What must not miss that end removes
        itself from ``running`` first.
    :raises RuntimeError: no thread can be started; the next use tries again.
    """
    if target in running or target in _starting:
        return
    try:
        _starting.add(target)  # within the `try`: a signal handler may raise after any line
        start(name, _run_once, target, *arguments)
    except BaseException:
        _starting.discard(target)
        raise


def _run_once(target: Callable[..., object], *arguments: object) -> None:
    # Of several, which were started because of what signal handlers have raised, one runs.
    this = threading.current_thread()
    _starting.discard(target)  # first: who finds it there relies on this thread
    is_first = running.setdefault(target, this) is this
    try:
        if is_first:
            target(*arguments)
    finally:
        if running.get(target) is this:
            del running[target]


class CallbackThread:
    """
    Runs code of a program where no executor does: calls, in their order. One that blocks delays the others,
    but no timeout and no answer.
    """

    def __init__(self) -> None:
        self.begin_anew()

    def begin_anew(self) -> None:
        """Forget the calls; also for a forked child, which does not have the thread."""
        self._calls: SimpleQueue[Callable[[], object] | None] = SimpleQueue()

    def put(self, call: Callable[[], object]) -> None:
        """
        Have this called soon, from any thread.

        :raises RuntimeError: no thread can be started; the next use tries again.
        """
        self._calls.put(call)
        start_once("tf2_ros callbacks", self._run)

    def stop(self) -> None:
        """End the thread after the calls that were put."""
        self._calls.put(None)

    def _run(self) -> None:
        while (call := self._calls.get()) is not None:
            call_logged(call, "In a callback")
            del call  # it refers to what the program may want to be gone


callbacks = CallbackThread()


_WHERE = "In the thread that reports"


class InboxOwner(Protocol):
    """Decides when an inbox begins and ends."""

    @property
    def inbox(self) -> Inbox: ...

    def stop(self) -> None:
        """End the inbox, for good."""

    def _tf2_check(self) -> None:
        """Called every one or two seconds."""


_owners: LiveObjects[InboxOwner] = LiveObjects()
_checked: LiveObjects[Any] = LiveObjects()  # the method ``_tf2_check`` of each is called regularly
_checked_at = 0.0


def add_owner(owner: InboxOwner) -> None:
    """Serve the inbox of an owner, and check the owner regularly."""
    start_once("tf2_ros receiver", INBOXES.drain_when_due)
    start_once("tf2_ros reports", _report_and_check)
    _owners.add(owner)
    _checked.add(owner)


def check_regularly(checked: Any) -> None:
    """Call ``_tf2_check()`` every one or two seconds, as long as something else refers to the object."""
    _checked.add(checked)
    with suppress(RuntimeError):  # no thread can be started now; the next listener tries again
        start_once("tf2_ros reports", _report_and_check)


def _report_and_check() -> None:
    while INBOXES.await_report():
        call_logged(INBOXES.report_next, _WHERE)
        # A function, because variables of this loop would keep alive what is checked.
        call_logged(_check, _WHERE)


def _check() -> None:
    global _checked_at
    now = time.monotonic()
    if now - _checked_at >= CHECK_S:
        _checked_at = now
        for checked in _checked:
            call_logged(checked._tf2_check, _WHERE)


@atexit.register
def _stop_all() -> None:
    for owner in _owners:
        call_logged(owner.stop, "During interpreter shutdown")
    INBOXES.stop()
    callbacks.stop()
    for thread in list(running.values()):
        with suppress(AssertionError, RuntimeError):  # a dummy thread, see `_begin`
            thread.join(THREAD_END_WAIT_S)


def _after_fork_in_child() -> None:
    INBOXES.begin_anew()
    callbacks.begin_anew()
    running.clear()
    _starting.clear()
    lost = sum([owner.inbox.leave_to_parent() for owner in _owners])
    _owners.clear()
    _checked.clear()
    if lost:
        # Not logged through ROS, whose locks another thread may have held.
        logging.getLogger("tf2_ros").warning(
            f"Process {os.getpid()} was forked from a process with {counted(lost, 'listener')}. Inherited "
            "objects receive nothing: spawn the process instead of forking it, or create new listeners after "
            "the fork."
        )


os.register_at_fork(after_in_child=_after_fork_in_child)
