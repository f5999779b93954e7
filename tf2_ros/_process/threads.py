# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Start and end the helper threads of a process; callbacks that no executor runs wait for one of them."""

import threading
from _thread import start_new_thread
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
    """Wait for the ends of all that were stopped."""
    for thread in list(running.values()):
        with suppress(AssertionError, RuntimeError):  # a dummy thread, see `_begin`
            thread.join(THREAD_END_WAIT_S)


def forget_threads() -> None:
    """In a forked child, which has none of them."""
    callbacks.reset()
    running.clear()
    _starting.clear()
