# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""In forked children, refuse what they inherited, free the locks that they need, and destroy no node."""

import os
import threading

from tf2_py._internal import class_name, keep_for_ever
from tf2_ros._live_objects import LiveObjects

FORKED = "dead in this forked process"  # in the representation of an inherited object

# Held for short steps of waiting, and while what fills a buffer is noted. Meanwhile no user code runs, but
# for methods of a node that a program overrides. No finalizer takes it. There is one for the whole
# process, so that a fork can wait for whoever holds it. It is reentrant, because signal handlers may wait.
LOCK = threading.RLock()
os.register_at_fork(before=LOCK.acquire, after_in_parent=LOCK.release, after_in_child=LOCK.release)


def is_inherited(process: int | None) -> bool:
    """
    Whether what a process made is dead here, because this process is a forked child of it.

    None: it is not known, because a subclass does not call ``__init__``; the answer is False.
    """
    return process is not None and process != os.getpid()


def refuse_inherited(one: object, process: int | None) -> None:
    """Raise a RuntimeError if another process made this object, and this one has inherited it."""
    if is_inherited(process):
        name = class_name(type(one))
        raise RuntimeError(f"this {name} is {FORKED}: create a new one after the fork")


_of_middleware: LiveObjects[object] = LiveObjects()


def keep_in_children(node_or_executor: object) -> None:
    """
    Never destroy a node or an executor, and what it refers to, in a forked child.

    A child lacks the threads of the middleware, so destroying any part of a node may hang.
    """
    _of_middleware.add(node_or_executor)


def _after_fork_in_child() -> None:
    keep_for_ever(*_of_middleware)
    _of_middleware.clear()


os.register_at_fork(after_in_child=_after_fork_in_child)
