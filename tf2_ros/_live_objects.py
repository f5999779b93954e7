# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""List the live ones of the objects that were added."""

import weakref
from collections.abc import Iterator
from functools import partial
from typing import Generic, TypeVar

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
