# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a feed and its wire, a transport such as DDS or Zenoh, promise each other."""

import logging
import threading
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

from tf2_ros_tools.common.threads import start_and_wait

log = logging.getLogger("tf2_ros_tools.live")

DISCOVERY_S = 5.0  # in which robots, and their publishers, are usually found, and begin to be received
TYPE = "tf2_msgs::msg::dds_::TFMessage_"  # as ROS 2 calls tf2_msgs/TFMessage on DDS and on Zenoh
CLOSE_S = 5.0  # the longest wait of a feed that closes for a thread of its wire


class Publisher(NamedTuple):
    """
    Who publishes on a topic.

    Fields: ``topic``; ``node``, the name of the node with its namespace, or ``""`` if it is not known;
    ``detail``, further facts, such as the quality of service; ``id``, the gid of the publisher in
    hexadecimal, which is its name in listings and log lines while its node is not known.
    """

    topic: str
    node: str
    detail: str
    id: str = ""


class Take(Protocol):
    """Hands a serialized TFMessage to a feed, in any thread. It raises no exception: the feed logs them."""

    def __call__(
        self,
        data: bytes | memoryview,
        is_static: bool,
        publisher: str = "",
        sent_ns: int = 0,
        lost: int = 0,
        gid: bytes = b"",
    ) -> None:
        """
        Hand over a message.

        :param data: CDR with its encapsulation header.
        :param is_static: whether the topic is that of static transforms.
        :param publisher: the name of its node, or else the ``id`` of the :class:`Publisher`.
        :param sent_ns: when it was sent, by the clock of the robot, in ns since 1970. 0: not known.
        :param lost: how many messages of this publisher were lost since its last one. 0 also if the wire
            does not count losses.
        :param gid: of the publisher.
        """


# Ends a feed from a thread of the wire, for example if the robot uses simulated time; the text is the reason.
End = Callable[[str], None]


class Sender(Protocol):
    """Publishes serialized TFMessages on one topic."""

    def send(self, data: bytes) -> None:
        """
        Publish CDR with its encapsulation header. The wire must not hand it to ``take``: the feed inserts it.

        :raises ConnectionError: it cannot be sent.
        """


class Wire(Protocol):
    """
    A transport. Methods may be called by several threads at once. A lock of a wire is an ``RLock``, and
    nothing waits for a thread without a bound: a program may close a feed in a signal handler, which
    interrupts code that holds the lock, or what the thread needs.
    """

    counts_losses: bool  # whether it tells `take` what was lost

    def open(self, take: Take, end: End) -> None:
        """
        Begin to receive, and to call ``take`` in threads of the wire.

        :raises ConnectionError: nothing can be received; the text says what to do.
        """

    def close(self) -> None:
        """
        End, and with it all senders. Afterwards ``take`` is not called again, but for a call of it that
        closes the wire itself, or that lasts longer than ``CLOSE_S``.

        It may be called several times, in any thread, also in those of the wire. It raises no exception.
        """

    def publishers(self) -> list[Publisher]:
        """Who publishes on the two topics."""
        ...

    def why_silent(self, topic: str, seconds: float) -> str:
        """Why nothing was received on a topic for this time, as a clause; ``""`` if it is not known."""
        ...

    def sender(self, topic: str, is_static: bool) -> Sender:
        """
        Make a publisher; that of static transforms keeps the last message for late listeners.

        :raises ConnectionError: this wire only listens.
        """
        ...


class WireThread:
    """
    A thread of a wire. Whatever ends it ends the feed, which would otherwise seem to receive.

    :param where: its name.
    :param receive: what it does.
    :param end: ends the feed.
    """

    def __init__(self, where: str, receive: Callable[[], None], end: End) -> None:
        self._where, self._receive, self._end = where, receive, end
        self._has_ended = False
        self._thread = threading.Thread(target=self._run, name=where, daemon=True)
        start_and_wait(self._thread)

    def _run(self) -> None:
        reason = "its thread has ended"
        try:
            self._receive()
        except BaseException as error:  # also SystemExit, which a callback of the program may raise
            log.exception(f"{self._where}: receiving failed")
            reason = f"receiving failed: {error!r}"
        finally:
            self._end(reason)
            self._has_ended = True

    @staticmethod
    def wait_for(threads: "Sequence[WireThread]") -> None:
        """Wait until all of these have ended, but no longer than ``CLOSE_S``, and in none of them."""
        if threading.current_thread() in [one._thread for one in threads]:
            return
        # Not with `join`, which takes a lock that a signal handler could meet.
        deadline_s = time.monotonic() + CLOSE_S
        while not all(one._has_ended for one in threads) and time.monotonic() < deadline_s:
            time.sleep(0.001)
