"""Let forks wait for short steps, end inherited objects in forked children, and list live objects."""

import os
import threading
import weakref
from collections.abc import Iterator
from typing import Generic, Protocol, TypeVar

from tf2_py._internal import keep_for_ever as keep_for_ever

FORKED = "dead in this forked process"  # in the representation of an inherited object

# Held for short steps of waiting, none of which runs user code. There is one for the whole process, so that a
# fork can wait for all of them; it is reentrant, because finalizers and signal handlers may wait, too.
LOCK = threading.RLock()

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
        address, forget = id(one), self._references.pop
        self._references[address] = weakref.ref(one, lambda _: forget(address, None))

    def discard(self, one: _Object) -> None:
        """Remove an object, if it is there."""
        self._references.pop(id(one), None)

    def clear(self) -> None:
        """Remove all objects."""
        self._references.clear()

    def __bool__(self) -> bool:
        return bool(self._references)

    def __iter__(self) -> Iterator[_Object]:
        found = [reference() for reference in list(self._references.values())]
        return iter([one for one in found if one is not None])


class Inherited(Protocol):
    """An object that a forked child inherits from its parent."""

    def after_fork(self) -> None:
        """End, or begin anew, in the child, whose only thread is the one that forked."""


_inherited: LiveObjects[Inherited] = LiveObjects()


def register_for_fork(owner: Inherited) -> None:
    """Call ``after_fork()`` of an object in every forked child, as long as something else refers to it."""
    _inherited.add(owner)


_generation = 0


def generation() -> int:
    """How many forks lie between the first process and this one. Futures of another generation are dead."""
    return _generation


def _after_fork_in_child() -> None:
    global _generation
    _generation += 1
    LOCK.release()
    for owner in _inherited:
        owner.after_fork()


os.register_at_fork(before=LOCK.acquire, after_in_parent=LOCK.release, after_in_child=_after_fork_in_child)
