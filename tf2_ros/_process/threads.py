# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Start and end the helper threads of a process; callbacks that no executor runs wait for one of them."""

import threading
from _thread import LockType, allocate_lock, start_new_thread
from collections.abc import Callable
from contextlib import suppress
from queue import SimpleQueue

from tf2_py._internal import log

THREAD_END_WAIT_S = 5.0  # how long to wait for a thread to end; only a very busy machine needs this long


def call_logged(call: Callable[[], object], where: str) -> None:
    """Call something, and log what it raises, because no caller would catch it."""
    try:
        call()
    except BaseException as error:
        log.raised(error, where)


# Of threads that were started and have not begun yet: locks that are free once they have.
_beginning: set[LockType] = set()
_refuses = False  # because the interpreter exits


def start(name: str, target: Callable[..., object], *arguments: object) -> None:
    """
    Start a thread; returns at once.

    :raises RuntimeError: no thread can be started.
    """
    _start(threading.Thread(target=target, args=arguments, name=name, daemon=True), runs_here=True)


def start_and_wait(thread: threading.Thread) -> None:
    """
    Start a thread, and return once it runs. After an exception of a signal handler it may still begin.

    :raises RuntimeError: no thread can be started.
    """
    with _start(thread, runs_here=False):
        if thread.ident is None:
            raise RuntimeError("cannot start another thread")


def _start(thread: threading.Thread, runs_here: bool) -> LockType:
    # A thread that begins while the interpreter is finalized crashes: `join_threads` waits for all in
    # `_beginning`, and later ones are refused. So this adds the lock first, and then checks.
    begun, identifiers = allocate_lock(), list[int]()
    begun.acquire()
    try:
        _beginning.add(begun)
        if _refuses:
            raise RuntimeError("cannot start a thread during interpreter shutdown")
        # One call in C, so that no signal handler runs between the start and the note that there was one.
        identifiers.extend(map(start_new_thread, [_begin], [(thread, begun, runs_here)]))
    finally:
        if not identifiers:
            _beginning.discard(begun)
    return begun


def _begin(thread: threading.Thread, begun: LockType, runs_here: bool) -> None:
    # In a thread of its own, where no signal handler runs. `Thread.start` waits for the new thread in Python:
    # what a handler raises there surfaces as an error of a lock, or the new thread waits forever.
    try:
        with suppress(RuntimeError, MemoryError):  # this thread could be started, another one cannot
            thread.start()
    finally:
        _beginning.discard(begun)
        begun.release()
    if runs_here and thread.ident is None:
        thread.run()


def await_beginnings() -> None:
    """Wait until all threads that were started have begun."""
    for begun in list(_beginning):
        if begun.acquire(timeout=THREAD_END_WAIT_S):
            begun.release()


# Those of this process that run a target of `start_once`, and the targets whose threads have not begun yet.
running: dict[Callable[..., object], threading.Thread] = {}
_starting: set[Callable[..., object]] = set()


def start_once(name: str, target: Callable[..., object], *arguments: object) -> None:
    """
    Start a thread, unless one runs this target; returns at once.

    :param target: after its end, the next use starts another thread.
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
        self.reset()

    def reset(self) -> None:
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


def join_threads() -> None:
    """At the exit of the interpreter, wait for the ends of all that were stopped, and let no other begin."""
    global _refuses
    _refuses = True
    await_beginnings()
    for thread in list(running.values()):
        with suppress(AssertionError, RuntimeError):  # a dummy thread, see `_begin`
            thread.join(THREAD_END_WAIT_S)


def forget_threads() -> None:
    """In a forked child, which has none of them."""
    callbacks.reset()
    running.clear()
    _starting.clear()
    _beginning.clear()
