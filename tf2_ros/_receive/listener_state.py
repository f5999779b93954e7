# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The state of a listener: its topics, its buffer, and what receives for it."""

from collections.abc import Sequence
from typing import Any

from tf2_ros._receive.listener_receiver import Receiver
from tf2_ros._receive.listener_topics import Topic


class ListenerState:
    """
    What a listener has, for the modules that receive for it.

    Its fields have these values until the listener is made, and for good in a subclass that does not call
    ``__init__``.
    """

    def __init__(self) -> None:
        self.buffer: Any = None
        self.topics: Sequence[Topic] = ()
        self.prefix = ""
        self.recording: Any = None
        self.process: int | None = None
        self.owns_node = False
        self.spinner: Any = None  # the thread that spins the node
        self.call_queue: Any = None  # of the node; None: that is of a program's own kind
        self.receiver: Receiver | None = None  # None: executors take the messages
