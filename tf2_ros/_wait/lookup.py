"""Owns what a wait is about: one lookup, with its arguments by name."""

from collections.abc import Callable
from typing import Any, NamedTuple

from tf2_py import BufferCore

__all__ = ["Lookup"]


class Lookup(NamedTuple):
    """
    The arguments of a lookup, in the order of ``lookup_transform_full``.

    A simple lookup has one time, its ``source_time``; its ``target_time`` and ``fixed_frame`` are None.
    """

    target_frame: str
    target_time: Any
    source_frame: str
    source_time: Any
    fixed_frame: str | None

    @classmethod
    def simple(cls, target_frame: str, source_frame: str, time: Any) -> "Lookup":
        """The lookup of ``lookup_transform``."""
        return cls(target_frame, None, source_frame, time, None)

    def now(self, core: BufferCore) -> Any:
        """What it gives without a wait: the answer, or the error."""
        if self.fixed_frame is None:
            return BufferCore.lookup_transform_core(
                core, self.target_frame, self.source_frame, self.source_time
            )
        return BufferCore.lookup_transform_full_core(
            core, self.target_frame, self.target_time, self.source_frame, self.source_time, self.fixed_frame
        )

    def wait(self, core: BufferCore, notify: Callable[[Any], Any] | None = None) -> Any:
        """
        Begin to wait for it; see ``BufferCore._wait``, which a program's method of that name does not
        replace.

        :param notify: called with the answer. None: a thread is going to block.
        """
        return BufferCore._wait(
            core,
            self.target_frame,
            self.source_frame,
            self.source_time,
            self.fixed_frame,
            self.target_time,
            notify=notify,
        )
