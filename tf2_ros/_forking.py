"""Refuse what forked children inherited, free the locks that they need, and list live objects."""

import os
import threading
import weakref
from collections.abc import Iterator
from functools import partial
from typing import Generic, TypeVar

from tf2_py._internal import class_name

FORKED = "dead in this forked process"  # in the representation of an inherited object

# Held for short steps of waiting, and by whoever decides what fills a buffer. Meanwhile no user code runs,
# but for methods of a node that a program overrides. No finalizer takes it. There is one for the whole
# process, so that a fork can wait for whoever holds it. It is reentrant, because signal handlers may wait.
LOCK = threading.RLock()
os.register_at_fork(before=LOCK.acquire, after_in_parent=LOCK.release, after_in_child=LOCK.release)

_Object = TypeVar("_Object")


class LiveObjects(Generic[_Object]):
    """
    The added objects that still exist, in their order; this keeps none of them alive.

    A WeakSet cannot be listed while another thread adds to it, and needs objects that have a hash.
    """

    def __init__(self) -> None:
        self._references: dict[int, weakref.ref[_Object]] = {}  # by their addresses

    def add(self, one: _Object) -> None:
        """Add an object."""
        # In C, with the reference as the default of `pop`: Python would print and drop what a signal handler
        # raises in a callback of its own, and so a Ctrl-C.
        address = id(one)
        self._references[address] = weakref.ref(one, partial(self._references.pop, address))

    def discard(self, one: _Object) -> None:
        """Remove an object, if it was added."""
        self._references.pop(id(one), None)

    def clear(self) -> None:
        """Remove all objects."""
        self._references.clear()

    def __iter__(self) -> Iterator[_Object]:
        found = [reference() for reference in list(self._references.values())]
        return iter([one for one in found if one is not None])


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
