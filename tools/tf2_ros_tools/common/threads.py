# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Start threads; Python does not end before they have begun."""

import atexit
import os
import threading
from _thread import LockType, allocate_lock, start_new_thread
from contextlib import suppress

BEGIN_S = 5.0  # only a very busy machine needs this long

# Of threads that were started and have not begun yet: locks that are free once they have.
_beginning: set[LockType] = set()
_refuses = False  # because Python ends


def start_and_wait(thread: threading.Thread) -> None:
    """
    Start a thread, and return once it runs. After an exception of a signal handler it may still begin.

    :raises RuntimeError: no thread can be started.

    A thread that begins while Python ends crashes, so the exit waits for all, and later ones are refused.
    """
    begun, identifiers = allocate_lock(), list[int]()
    begun.acquire()
    try:
        _beginning.add(begun)
        if _refuses:  # to be checked after this was added
            raise RuntimeError("cannot start a thread while Python ends")
        # One call in C, so that no signal handler runs between the start and the note that there was one.
        identifiers.extend(map(start_new_thread, [_begin], [(thread, begun)]))
    finally:
        if not identifiers:
            _beginning.discard(begun)
    with begun:
        if thread.ident is None:
            raise RuntimeError("cannot start another thread")


def _begin(thread: threading.Thread, begun: LockType) -> None:
    # In a thread of its own, where no signal handler runs: what one raised would interrupt `Thread.start`
    # while it holds a lock that the new thread needs.
    try:
        with suppress(RuntimeError, MemoryError):  # the thread has no identifier then
            thread.start()
    finally:
        _beginning.discard(begun)
        begun.release()


@atexit.register
def _await_beginnings() -> None:
    global _refuses
    _refuses = True
    for begun in list(_beginning):
        if begun.acquire(timeout=BEGIN_S):
            begun.release()


os.register_at_fork(after_in_child=_beginning.clear)
