# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Know the listeners that fill a buffer, and say on which of their topics nothing arrives."""

import os
import time
from collections.abc import Sequence
from typing import Any

from tf2_py import BufferCore
from tf2_ros._buffer_fillers import describe_silence_with, note_filler
from tf2_ros._live_objects import LiveObjects
from tf2_ros._receive.listener_topics import Topic

# A topic of dynamic transforms is called silent if nothing was received on it for this long. Most are sent
# ten times a second or more.
SILENT_S = 3


_listeners: LiveObjects[Any] = LiveObjects()  # of the class TransformListener


def note_listener(listener: Any) -> None:
    """Note that a TransformListener fills its buffer from now on."""
    buffer = listener.buffer
    _listeners.add(listener)
    # A subclass that does not call __init__ may not have a node yet.
    note_filler(getattr(listener, "node", None), buffer, listener._tf2_state.call_queue)
    if issubclass(type(buffer), BufferCore):  # isinstance believes a Mock(spec=Buffer)
        describe_silence_with(buffer, _silence)


def _open_topics(buffer: object) -> list[Topic]:
    """The topics on which the listeners of a buffer can receive anything."""
    listeners = [one for one in _listeners if getattr(one, "buffer", None) is buffer]
    return [topic for listener in listeners for topic in listener._tf2_state.topics if topic.is_open()]


def _silence(buffer: object) -> tuple[str, str]:
    # What BufferCore._describe_silence_with expects.
    topics = [topic for topic in _open_topics(buffer) if topic.is_own]
    return _silent(topics), _silent([topic for topic in topics if not topic.is_static])


def _silent(topics: Sequence[Topic]) -> str:
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


# A forked child receives nothing through its parent's listeners, and may make its own for the same buffers.
os.register_at_fork(after_in_child=_listeners.clear)
