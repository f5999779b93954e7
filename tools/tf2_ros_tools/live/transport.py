# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a feed and its wire, a transport such as DDS or Zenoh, promise each other."""

import logging
import os
import threading
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol
from urllib.parse import parse_qsl, urlsplit

log = logging.getLogger("tf2_ros_tools.live")

EXAMPLES = "zenoh://robot:7447, dds://, dds://?peers=192.168.0.7 or ws://robot:8765"
DISCOVERY_S = 5.0  # in which robots, and their publishers, are usually found, and begin to be received
TYPE = "tf2_msgs::msg::dds_::TFMessage_"  # as ROS 2 calls tf2_msgs/TFMessage on DDS and on Zenoh
CLOSE_S = 5.0  # the longest wait of a feed that closes for a thread of its wire


class Address(NamedTuple):
    """Where a robot is: what ``connect`` was given, in parts."""

    where: str  # as a whole
    scheme: str
    host: str  # "" if there is none
    port: int | None
    options: dict[str, str]  # what follows the question mark
    domain: int  # of ROS
    topics: tuple[str, str]  # of dynamic and of static transforms, with their slashes


class Publisher(NamedTuple):
    """
    Who publishes on a topic.

    Fields: ``topic``; ``node``, the name of the node with its namespace, or ``""`` if it is not known;
    ``detail``, further facts, such as the quality of service; ``id``, the name of the publisher in listings
    and log lines while its node is not known.
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
    ) -> None:
        """
        Hand over a message.

        :param data: CDR with its encapsulation header.
        :param is_static: whether the topic is that of static transforms.
        :param publisher: the name of its node, or else the ``id`` of the :class:`Publisher`.
        :param sent_ns: when it was sent, by the clock of the robot, in ns since 1970. 0: not known.
        :param lost: how many messages of this publisher were lost since its last one. 0 also if the wire
            does not count losses.
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
    A transport. Methods may be called by several threads at once, and in a signal handler that interrupts
    any of them. So a lock of a wire is an ``RLock``, which a handler can take once more, and nothing waits
    for a thread without a bound, because the code that a handler interrupts may hold what the thread needs.
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
        self._thread.start()

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


def parse(where: str, domain: int | None, topics: tuple[str, str]) -> Address:
    """
    Take apart what ``connect`` was given.

    :raises TypeError: the address is not a str.
    :raises ValueError: the address, the domain or the name of a topic is invalid.
    """
    if not isinstance(where, str):
        raise TypeError(f"where: expected a str, such as {EXAMPLES}, got {type(where).__name__}")
    try:
        parts = urlsplit(where)
        port = parts.port
        if port == 0:
            raise ValueError("a port is a number from 1 to 65535")
        if "://" in where and (parts.path.strip("/") or parts.fragment or parts.username is not None):
            raise ValueError("only a host, a port and options are understood")
    except ValueError as error:
        raise ValueError(f"expected an address such as {EXAMPLES}, got {where!r}: {error}") from None
    names = tuple(_topic(name) for name in topics)
    if names[0] == names[1]:
        raise ValueError(f"topic and static_topic must differ, but both are {names[0]!r}")
    return Address(
        where,
        parts.scheme,
        parts.hostname or "",
        port,
        dict(parse_qsl(parts.query, keep_blank_values=True)),
        _domain(domain),
        (names[0], names[1]),
    )


def refuse_options(address: Address, *known: str) -> None:
    """Raise a ValueError if an address has options other than these."""
    if unknown := [name for name in address.options if name not in known]:
        accepted = " and ".join(known) or "none"
        text = f"unknown option {unknown[0]!r}; {address.scheme}:// accepts {accepted}"
        raise ValueError(f"{address.where}: {text}")


def _topic(name: str) -> str:
    if not isinstance(name, str) or not name.strip("/"):
        raise ValueError(f"expected the name of a topic, such as /tf, got {name!r}")
    return f"/{name.strip('/')}"


def _domain(domain: int | None) -> int:
    if domain is None:
        text = os.environ.get("ROS_DOMAIN_ID") or "0"
        if not text.isdecimal() or int(text) > 232:
            raise ValueError(f"ROS_DOMAIN_ID: expected a number from 0 to 232, got {text!r}")
        return int(text)
    if not isinstance(domain, int) or isinstance(domain, bool) or not 0 <= domain <= 232:
        raise ValueError(f"domain: expected a number from 0 to 232, got {domain!r}")
    return domain
