"""Owns what a fork waits for, and what a forked child does with what it gets from its parent."""

import os
import threading
import weakref
from typing import Protocol

from tf2_py._internal import keep_for_ever

__all__ = ["LOCK", "Inherited", "keep_for_ever", "register_for_fork"]

# For short steps of waiting, none of which runs user code. One for the whole process, so that a fork can wait
# for all of them; reentrant, because finalizers and signal handlers may wait, too.
LOCK = threading.RLock()


class Inherited(Protocol):
    """What a forked child gets from its parent."""

    def after_fork(self) -> None:
        """Called in the child, whose only thread is the one that forked."""


# By their addresses: a subclass may have no hash.
_inherited: "dict[int, weakref.ref[Inherited]]" = {}


def register_for_fork(owner: Inherited) -> None:
    """Call ``after_fork()`` of this in every forked child, as long as something else refers to it."""
    address, forget = id(owner), _inherited.pop
    _inherited[address] = weakref.ref(owner, lambda _: forget(address, None))


def _after_fork_in_child() -> None:
    LOCK.release()
    inherited = [reference() for reference in list(_inherited.values())]
    for owner in inherited:
        if owner is not None:
            owner.after_fork()


os.register_at_fork(before=LOCK.acquire, after_in_parent=LOCK.release, after_in_child=_after_fork_in_child)
