# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Know what fills a buffer, listeners or sources of a program, and end waits when all of it has ended."""

import weakref
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from tf2_py import BufferCore
from tf2_py.printable import printable
from tf2_ros._process.forking import LOCK
from tf2_ros_cython._ros_presence import HAS_ROS

if TYPE_CHECKING or HAS_ROS:
    from rclpy.utilities import get_default_context

    from tf2_ros._rclpy import context_was_shut_down, is_node


SHUT_DOWN = "The context was shut down"
NEVER_FILLED = "it has no TransformListener and nothing was inserted"


class Filler(Protocol):
    """Something that fills a buffer."""

    def why_ended(self) -> str:
        """Say why it fills the buffer no more; ``""`` while it does."""
        ...


class _Context(NamedTuple):
    """The context of something that fills a buffer."""

    context: Any

    def why_ended(self) -> str:
        return SHUT_DOWN if context_was_shut_down(self.context) else ""


class BufferSource:
    """
    What fills a buffer besides listeners, such as a connection to a robot: see :meth:`Buffer.add_source`.

    :param name: what errors call it.
    :param silence: see :meth:`Buffer.add_source`.

    >>> from tf2_ros import Buffer
    >>> source = Buffer().add_source("the simulator")
    >>> source.end("it was closed")
    >>> source
    <BufferSource 'the simulator': the simulator has ended (it was closed)>
    """

    def __init__(self, name: str, silence: "Callable[[bool], str] | None" = None) -> None:
        self.name = name
        self._silence = silence
        self._why_ended = ""

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name!r}{': ' if self._why_ended else ''}{self._why_ended}>"

    def end(self, reason: str = "") -> None:
        """
        Report that this source no longer fills the buffer. Any thread may call this; later calls do nothing.

        Unless something else also fills the buffer, its blocking lookups and its awaits in asyncio end within
        0.1 s, with an error that contains the reason; futures, and awaits in an executor of rclpy, wait for
        their timeout. The buffer keeps what it holds.
        """
        if not self._why_ended:
            self._why_ended = f"{printable(self.name)} has ended" + (f" ({reason})" if reason else "")

    def why_ended(self) -> str:
        """Return why it has ended, as a text for errors; ``""`` while it fills the buffer."""
        return self._why_ended

    def silence(self, with_static: bool) -> str:
        """Say what this has not received, see :meth:`Buffer.add_source`."""
        return "" if self._silence is None or self._why_ended else self._silence(with_static)


class Fillers:
    """
    Everything that fills one buffer: the contexts of its node and its listeners, also of ended ones, and its
    sources; and the call queues of the listeners' nodes.
    """

    def __init__(self) -> None:
        # Replaced, never changed: read without a lock.
        self.known: tuple[Filler, ...] = ()  # without those that had ended when the last was added
        self.call_queues: tuple[weakref.ref[Any], ...] = ()  # of the latest listener last
        self.find_silence: Callable[[object], tuple[str, str]] | None = None  # on the listeners' topics

    def add(self, filler: Filler, call_queue: object = None) -> None:
        """Note that something fills the buffer from now on; see :func:`note_filler`."""
        with LOCK:
            others = (one for one in self.known if one != filler and not one.why_ended())
            self.known = (*others, filler)
            if call_queue is not None:
                known = (one for one in self.call_queues if one() not in (None, call_queue))
                self.call_queues = (*known, weakref.ref(call_queue))


_NOTHING_KNOWN = Fillers()


def begin_fillers(buffer: BufferCore) -> Fillers:
    """Make the empty record of what fills a new ``Buffer``; errors say that nothing fills it."""
    BufferCore._describe_silence_with(buffer, silence_of)
    return Fillers()


def note_filler(node: Any, buffer: object, call_queue: object = None) -> None:
    """
    Note that something of this node fills the buffer from now on; without effect unless it is a ``Buffer``.

    :param call_queue: of a listener's node; None for anything else.
    """
    fillers = getattr(buffer, "_tf2_fillers", None)
    if is_node(node) and isinstance(fillers, Fillers):
        fillers.add(_Context(node.context), call_queue)


def add_source(buffer: Any, name: str, silence: "Callable[[bool], str] | None") -> BufferSource:
    """See :meth:`Buffer.add_source`."""
    source = BufferSource(name, silence)
    buffer._tf2_fillers.add(source)
    BufferCore._describe_silence_with(buffer, silence_of)
    return source


def describe_silence_with(buffer: BufferCore, find_silence: Callable[[object], tuple[str, str]]) -> None:
    """
    Have the errors of a buffer say which topics of its listeners are silent.

    :param find_silence: see ``BufferCore._describe_silence_with``.
    """
    fillers = getattr(buffer, "_tf2_fillers", None)
    if isinstance(fillers, Fillers):
        fillers.find_silence, find_silence = find_silence, silence_of
    BufferCore._describe_silence_with(buffer, find_silence)


def _sources(fillers: Fillers) -> list[BufferSource]:
    return [one for one in fillers.known if isinstance(one, BufferSource)]


def has_filler(buffer: Any) -> bool:
    """Whether a ``Buffer`` has, or has had, a listener or a source, so that a clock set back clears it."""
    fillers: Fillers = buffer._tf2_fillers
    return fillers.find_silence is not None or bool(_sources(fillers))


def silence_of(buffer: Any) -> tuple[str, str]:
    """What the errors of a ``Buffer`` say about what fills it, see ``BufferCore._describe_silence_with``."""
    fillers: Fillers = buffer._tf2_fillers
    sources = _sources(fillers)
    if not has_filler(buffer):
        return "" if _has_had_data(buffer) else NEVER_FILLED, ""
    found = [("", "") if fillers.find_silence is None else fillers.find_silence(buffer)]
    found += [(one.silence(True), one.silence(False)) for one in sources]
    with_static, without = (" and ".join(filter(None, clauses)) for clauses in zip(*found, strict=True))
    return with_static, without


def _has_had_data(buffer: Any) -> bool:
    counts = BufferCore.statistics(buffer)
    return bool(counts["frames"] or counts["taken"])


class Shutdown:
    """
    The end of everything that fills a buffer, which ends one wait; the wait begins when this is made.

    Two of them are equal if the same ends their waits.

    :param core: the buffer; this does not keep it alive.

    If nothing is known that fills the buffer, the program inserts transforms itself. Then only a shutdown of
    the default context during the wait ends it, so that Ctrl-C does.
    """

    __slots__ = ("_default", "_fillers")

    def __init__(self, core: object) -> None:
        self._fillers: Fillers = getattr(core, "_tf2_fillers", _NOTHING_KNOWN)
        self._default: tuple[_Context, ...] = ()
        if HAS_ROS and not self._fillers.known:
            default = _Context(get_default_context())
            if not default.why_ended():
                self._default = (default,)

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Shutdown)
            and self._fillers is other._fillers
            and self._default == other._default
        )

    def __hash__(self) -> int:
        return hash((id(self._fillers), bool(self._default)))

    def __call__(self) -> bool:
        """Whether nothing fills the buffer any more, also since before the wait."""
        return self.why() != ""

    def why(self) -> str:
        """Why nothing does, for the error of the wait; ``""`` while something does."""
        reasons = [one.why_ended() for one in self._fillers.known or self._default]
        return reasons[-1] if reasons and all(reasons) else ""
