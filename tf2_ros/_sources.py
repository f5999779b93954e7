# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Know what fills a buffer, listeners or sources of a program: what is silent, and whether all has ended."""

import os
import time
import weakref
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

from tf2_py import BufferCore
from tf2_py.printable import printable
from tf2_ros._live_objects import LiveObjects
from tf2_ros._process.background import background
from tf2_ros._process.forking import LOCK
from tf2_ros_cython._ros_presence import HAS_ROS

if TYPE_CHECKING or HAS_ROS:
    from rclpy.utilities import get_default_context

    from tf2_ros._rclpy import context_was_shut_down, is_node


SHUT_DOWN = "The context was shut down"
NEVER_FILLED = "it has no TransformListener and nothing was inserted"

# A topic of dynamic transforms is called silent if nothing was received on it for this long. Most are sent
# ten times a second or more.
SILENT_S = 3


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

        Unless the buffer has a node, or something else also fills it, its blocking lookups and its awaits in
        asyncio end within 0.1 s, with an error that contains the reason; futures, and awaits in an executor
        of rclpy, wait for their timeout. The buffer keeps what it holds.
        """
        if not self._why_ended:
            self._why_ended = f"{printable(self.name)} has ended" + (f" ({reason})" if reason else "")

    def why_ended(self) -> str:
        """Return why it has ended, as a text for errors; ``""`` while it fills the buffer."""
        return self._why_ended

    def is_asked(self) -> bool:
        """Whether `silence` calls a function of the program."""
        return self._silence is not None and not self._why_ended

    def silence(self, with_static: bool) -> str:
        """Say what this has not received, see :meth:`Buffer.add_source`."""
        return "" if self._silence is None or self._why_ended else self._silence(with_static)


class _Context(NamedTuple):
    """The context of the buffer's node, or of listeners, also of ended ones."""

    context: Any

    def why_ended(self) -> str:
        return SHUT_DOWN if context_was_shut_down(self.context) else ""


class Sources:
    """Everything that fills one ``Buffer``, and the call queues of the listeners' nodes."""

    def __init__(self) -> None:
        # Replaced, never changed: read without a lock.
        self.known: tuple[BufferSource | _Context, ...] = ()  # but for those that had ended at the last `add`
        self.call_queues: tuple[weakref.ref[Any], ...] = ()  # of the latest listener last
        self.has_any = False  # or has had: a listener or a source, so that a clock set back clears the buffer

    def add(self, source: BufferSource | _Context, call_queue: object = None) -> None:
        """Note what fills the buffer from now on; `call_queue`: of a listener's node."""
        with LOCK:
            others = (one for one in self.known if one != source and not one.why_ended())
            self.known = (*others, source)
            if call_queue is not None:
                known = (one for one in self.call_queues if one() not in (None, call_queue))
                self.call_queues = (*known, weakref.ref(call_queue))


_NOTHING_KNOWN = Sources()
_listeners: LiveObjects[Any] = LiveObjects()  # of the class TransformListener
# A forked child receives nothing through its parent's listeners, and may make its own for the same buffers.
os.register_at_fork(after_in_child=_listeners.clear)


def sources_of(buffer: object) -> Sources:
    """What fills a buffer; nothing is known of any but a ``Buffer``."""
    found = getattr(buffer, "_tf2_sources", None)
    return found if isinstance(found, Sources) else _NOTHING_KNOWN


def add_source(buffer: Any, name: str, silence: "Callable[[bool], str] | None") -> BufferSource:
    """See :meth:`Buffer.add_source`."""
    source = BufferSource(name, silence)
    buffer._tf2_sources.add(source)
    _describe_silence(buffer)
    return source


def add_node(node: Any, buffer: object, call_queue: object = None) -> None:
    """Note that something of a node, if it is one of rclpy's, fills a buffer, if it is a ``Buffer``."""
    sources = sources_of(buffer)
    if sources is not _NOTHING_KNOWN and is_node(node):
        sources.add(_Context(node.context), call_queue)


def add_listener(listener: Any) -> None:
    """Note that a TransformListener fills its buffer from now on."""
    _listeners.add(listener)
    # A subclass that does not call __init__ may not have a node yet.
    add_node(getattr(listener, "node", None), listener.buffer, listener._tf2_state.call_queue)
    if issubclass(type(listener.buffer), BufferCore):  # isinstance believes a Mock(spec=Buffer)
        _describe_silence(listener.buffer)


def _describe_silence(buffer: BufferCore) -> None:
    if (sources := sources_of(buffer)) is not _NOTHING_KNOWN:
        sources.has_any = True
    BufferCore._describe_silence_with(buffer, silence_of)


def silence_of(buffer: BufferCore) -> tuple[str, str]:
    """What errors say about what fills a buffer, see ``BufferCore._describe_silence_with``."""
    sources = sources_of(buffer)
    if sources is not _NOTHING_KNOWN and not sources.has_any:
        counts = BufferCore.statistics(buffer)
        return "" if counts["frames"] or counts["taken"] else NEVER_FILLED, ""
    listeners = [one for one in _listeners if getattr(one, "buffer", None) is buffer]
    topics = [topic for one in listeners for topic in one._tf2_state.topics]
    topics = [topic for topic in topics if topic.is_own and topic.is_open()]
    own: list[BufferSource] = []
    if not background.is_here():  # there, only timeouts need them, which ask elsewhere
        own = [one for one in sources.known if isinstance(one, BufferSource)]

    def clause(with_static: bool) -> str:
        silent = _silent([one for one in topics if with_static or not one.is_static])
        return " and ".join(filter(None, [silent, *[one.silence(with_static) for one in own]]))

    return clause(True), clause(False)


def asks_program(buffer: object) -> bool:
    """Whether an error of this buffer calls a function of a program, see :meth:`Buffer.add_source`."""
    return any(isinstance(one, BufferSource) and one.is_asked() for one in sources_of(buffer).known)


def _silent(topics: Iterable[Any]) -> str:
    """Describe the silent ones of these topics in a clause without commas; ``""`` if there are none."""
    # Several listeners may receive on one topic.
    lasts: dict[str, int] = {}
    for topic in topics:
        lasts[topic.name] = max(lasts.get(topic.name, 0), topic.arrivals.taken()[1])
    static = {topic.name for topic in topics if topic.is_static}
    instead = {topic.name: topic.published_instead for topic in topics}
    parts = []
    for name, last_ns in lasts.items():
        silent_s = (time.monotonic_ns() - last_ns) // 10**9
        if last_ns == 0:
            parts.append(f"on {name}{instead[name] and f' ({instead[name]})'}")
        elif silent_s >= SILENT_S and name not in static:  # static transforms are sent once
            parts.append(f"on {name} for {silent_s} s")
    return "nothing has been received " + " or ".join(parts) if parts else ""


class Shutdown:
    """
    The end of everything that fills a buffer, which ends one wait; the wait begins when this is made.

    Two of them are equal if the same ends their waits.

    :param core: the buffer; this does not keep it alive.

    If nothing is known that fills the buffer, the program inserts transforms itself. Then only a shutdown of
    the default context during the wait ends it, so that Ctrl-C does.
    """

    __slots__ = ("_default", "_sources")

    def __init__(self, core: object) -> None:
        self._sources = sources_of(core)
        self._default: tuple[_Context, ...] = ()
        if HAS_ROS and not self._sources.known:
            default = _Context(get_default_context())
            if not default.why_ended():
                self._default = (default,)

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Shutdown)
            and self._sources is other._sources
            and self._default == other._default
        )

    def __hash__(self) -> int:
        return hash((id(self._sources), bool(self._default)))

    def __call__(self) -> bool:
        """Whether nothing fills the buffer any more, also since before the wait."""
        return self.why() != ""

    def why(self) -> str:
        """Why nothing does, for the error of the wait; ``""`` while something does."""
        reasons = [one.why_ended() for one in self._sources.known or self._default]
        return reasons[-1] if reasons and all(reasons) else ""
