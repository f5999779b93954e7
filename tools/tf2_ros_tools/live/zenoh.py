# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Receive transforms from nodes with rmw_zenoh, and send some, with eclipse-zenoh."""

import json
import logging
import os
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from itertools import count
from typing import Any, NamedTuple

import zenoh
from xxhash import xxh3_128_digest
from zenoh import ext
from zenoh.handlers import FifoChannel

from tf2_ros_tools.common.output import first_names
from tf2_ros_tools.live.address import Address, refuse_options
from tf2_ros_tools.live.transport import TYPE, End, Publisher, Sender, Take, WireThread

log = logging.getLogger("tf2_ros_tools.live")

PORT = 7447
TYPE_HASH = "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"
NO_HASH = "TypeHashNotSupported"  # of Humble
DEPTH = 1000  # messages that wait while Python is busy: 5 s of 200 Hz
MOST_LOST = 2**31  # a larger gap between sequence numbers is a damaged number
HEARTBEAT_S = 0.5  # as in rmw_zenoh
ENDED_PUBLISHERS_KEPT = 1000  # whose name and last sequence number are known
OPEN_S = 5.0  # in which something that accepts connections must prove to be Zenoh
# What is attached to a message: its sequence number, when it was sent in ns, and the gid of its publisher.
# The length of the gid precedes it.
ATTACHMENT = struct.Struct("<qqB16s")
GID_BYTES = 16
# Tokens of Zenoh's liveliness say who is there.
TOKENS = "@ros2_lv"
NODE, PUBLISHER, SUBSCRIPTION = "NN", "MP", "MS"
TRANSIENT_LOCAL = "1"
QOS, LATCHED_QOS = f"::,{DEPTH}:,:,:,,", ":1:,1:,:,:,,"
CLOCK = "/clock"

# The process that has opened a session. Zenoh's threads stay in it, and a forked child has none of them.
_used_in: int | None = None


class _Publisher(NamedTuple):
    """What the token of a publisher says."""

    domain: str
    session: str
    node: str
    topic: str
    type: str
    type_hash: str
    qos: str


class ZenohWire:
    """Receives from the nodes that a router knows. A thread for each topic takes what arrives."""

    counts_losses = True

    def __init__(self, address: Address) -> None:
        if not address.host:
            raise ValueError(f"{address.where}: expected the host of a router, as in zenoh://robot:{PORT}")
        refuse_options(address)
        self._address = address
        host = f"[{address.host}]" if ":" in address.host else address.host
        self._endpoint = f"tcp/{host}:{address.port or PORT}"
        self._is_closed = False
        self._session: zenoh.Session | None = None
        self._closers: list[Callable[[], None]] = []  # what is left to do at the end, the last one first
        self._numbers = count()  # of the entities of this session
        self._announced: list[_Announcement] = []
        self._threads: list[WireThread] = []
        self._publishers: dict[str, _Publisher] = {}  # of all domains, without ours, by their tokens
        self._nodes: dict[bytes, str] = {}  # their names, by the gids of publishers

    def open(self, take: Take, end: End) -> None:
        self._session = session = self._connected()
        self._closers.append(session.close)
        self._own = str(session.info.zid())
        with _errors(self._address.where):
            # Every node has a publisher. First the names of those who are there, before their messages; then
            # of those who come and go.
            publishers = f"{TOKENS}/*/*/*/*/{PUBLISHER}/**"
            for reply in session.liveliness().get(publishers):
                if reply.ok is not None:
                    self._note(reply.ok, end)
            found = session.liveliness().declare_subscriber(publishers, FifoChannel(DEPTH), history=True)
            self._start(found, partial(self._note, end=end), end)
            self._announced.append(self._announce(NODE))
            for topic, is_static in zip(self._address.topics, (False, True), strict=True):
                qos = LATCHED_QOS if is_static else QOS
                self._announced.append(self._announce(SUBSCRIPTION, topic, qos))
                subscriber = ext.declare_advanced_subscriber(
                    session,
                    self._key(topic, "*"),
                    FifoChannel(DEPTH),
                    # What this program sends is inserted by the feed.
                    allowed_origin=zenoh.Locality.REMOTE,
                    history=ext.HistoryConfig(detect_late_publishers=True),
                    recovery=ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
                )
                hear = partial(self._hear, take=take, is_static=is_static, last={})
                self._start(subscriber, hear, end)

    def close(self) -> None:
        self._is_closed = True
        # Each is done once, whoever else closes this meanwhile. In 1.5 to 1.7, the end of the session does
        # not end what waits for a subscriber.
        with suppress(IndexError):
            while True:
                with suppress(zenoh.ZError):  # the router does not read
                    self._closers.pop()()
        WireThread.wait_for(self._threads)

    def publishers(self) -> list[Publisher]:
        return [
            Publisher(topic, one.node, one.type_hash, _gid(token).hex())
            for topic in self._address.topics
            for token, one in list(self._publishers.items())
            if (one.domain, one.topic) == (str(self._address.domain), topic)
        ]

    def why_silent(self, topic: str, seconds: float) -> str:
        session = self._session
        if session is None:
            return ""
        info = session.info
        if not info.routers_zid() and not info.peers_zid():
            return f"{self._endpoint} no longer answers"
        everyone = list(self._publishers.values())
        if not everyone:
            reached = f"{self._endpoint} is reached, but no node publishes {self._address.topics[0]} there"
            return f"{reached}: is the robot's RMW rmw_zenoh_cpp?"
        domain = str(self._address.domain)
        publishers = [one for one in everyone if one.topic in self._address.topics]
        if publishers and all(one.domain != domain for one in publishers):
            topics = " and ".join(sorted({one.topic for one in publishers}))
            verb = "are" if " and " in topics else "is"
            domains = first_names(sorted({one.domain for one in publishers}))
            return f"{topics} {verb} published in domain {domains}, and this feed is in domain {domain}"
        is_static = topic == self._address.topics[1]
        reasons = [f"{one.node} {_misfit(one, is_static)}" for one in self._others() if one.topic == topic]
        return first_names(reasons) or f"no node publishes {topic} in domain {domain}"

    def sender(self, topic: str, is_static: bool) -> Sender:
        assert self._session is not None
        # All nodes of a Humble robot announce that they have no hashes, and so do its subscriptions.
        is_humble = any(one.type_hash == NO_HASH for one in self._others())
        type_hash = NO_HASH if is_humble else TYPE_HASH
        key = self._key(topic, type_hash)
        with _errors(self._address.where):
            if is_static:
                publisher: Any = ext.declare_advanced_publisher(
                    self._session,
                    key,
                    encoding=zenoh.Encoding.ZENOH_BYTES,
                    congestion_control=zenoh.CongestionControl.BLOCK,
                    # A late listener needs only the last message, because it contains all static transforms.
                    cache=ext.CacheConfig(1),
                    sample_miss_detection=ext.MissDetectionConfig(
                        sporadic_heartbeat=HEARTBEAT_S, heartbeat=None
                    ),
                    publisher_detection=True,
                )
            else:
                publisher = self._session.declare_publisher(
                    key,
                    encoding=zenoh.Encoding.ZENOH_BYTES,
                    congestion_control=zenoh.CongestionControl.DROP,
                )
            qos = LATCHED_QOS if is_static else QOS
            announcement = self._announce(PUBLISHER, topic, qos, type_hash)
        return _ZenohSender(publisher, announcement, self._address.where)

    def _connected(self) -> zenoh.Session:
        global _used_in
        address = self._address
        if _used_in not in (None, os.getpid()):
            raise ConnectionError(
                f"{address.where}: Zenoh has been used by the parent process, so it cannot be used in a "
                "forked child, which has none of its threads. Start the child with the method 'spawn' of "
                "multiprocessing, or before the parent connects"
            )
        try:
            socket.getaddrinfo(address.host, None)
        except (OSError, UnicodeError) as error:
            raise ConnectionError(f"connect: the host {address.host} has no address: {error}") from None
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([self._endpoint]))
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("transport/unicast/open_timeout", f"{OPEN_S * 1000:.0f}")
        _used_in = os.getpid()
        try:
            return zenoh.open(config)
        except zenoh.ZError:
            raise ConnectionError(
                f"connect: nothing answers at {self._endpoint}. Start a router on the robot with ros2 run "
                "rmw_zenoh_cpp rmw_zenohd, or check the address"
            ) from None

    def _key(self, topic: str, type_hash: str) -> str:
        return f"{self._address.domain}{topic}/{TYPE}/{type_hash}"

    def _announce(
        self, kind: str, topic: str = "", qos: str = "", type_hash: str = TYPE_HASH
    ) -> "_Announcement":
        """Announce the node of this program, or what belongs to it."""
        assert self._session is not None
        numbers = f"0/{next(self._numbers)}"
        token = f"{TOKENS}/{self._address.domain}/{self._own}/{numbers}/{kind}/%/%/tf2_live_{self._own[:8]}"
        if topic:
            token += f"/{topic.replace('/', '%')}/{TYPE}/{type_hash}/{qos}"
        return _Announcement(self._session.liveliness().declare_token(token), _gid(token))

    def _start(self, subscriber: Any, handle: Callable[[zenoh.Sample], None], end: End) -> None:
        """Handle what arrives in a new thread, until the subscriber is undeclared."""

        def run() -> None:
            for sample in subscriber:
                if self._is_closed:
                    return
                handle(sample)

        self._closers.append(subscriber.undeclare)
        # Zenoh's own threads for callbacks would keep a program alive that has not closed its feed.
        self._threads.append(WireThread(self._address.where, run, end))

    def _others(self) -> list[_Publisher]:
        """The publishers in this domain, without ours."""
        domain = str(self._address.domain)
        return [one for one in list(self._publishers.values()) if one.domain == domain]

    def _note(self, news: zenoh.Sample, end: End) -> None:
        token = str(news.key_expr)
        publisher = _publisher_of(token)
        if news.kind != zenoh.SampleKind.PUT:
            self._publishers.pop(token, None)
        elif publisher is not None and publisher.session != self._own:
            self._publishers[token] = publisher
            self._nodes[_gid(token)] = publisher.node
            if len(self._nodes) > ENDED_PUBLISHERS_KEPT + 2 * len(self._publishers):
                self._forget_ended()
            if (publisher.domain, publisher.topic) == (str(self._address.domain), CLOCK):
                end("/clock is published, and simulated time is not supported")

    def _forget_ended(self) -> None:
        present = {_gid(token) for token in self._publishers}
        self._nodes = {gid: node for gid, node in self._nodes.items() if gid in present}

    def _hear(
        self, sample: zenoh.Sample, is_static: bool, take: Take, last: dict[bytes, tuple[int, int]]
    ) -> None:
        """
        Hand over a message.

        :param last: the sequence number of the last message, and when it was sent in ns, by gid.
        """
        if str(sample.key_expr).rpartition("/")[2] not in (TYPE_HASH, NO_HASH):
            return  # another definition of TFMessage
        data = sample.payload.to_bytes()
        attached = b"" if sample.attachment is None else sample.attachment.to_bytes()
        if len(attached) != ATTACHMENT.size or attached[16] != GID_BYTES:
            take(data, is_static)  # not from rmw_zenoh
            return
        sequence, sent_ns, _, gid = ATTACHMENT.unpack(attached)
        last_sequence, last_sent_ns = last.get(gid, (sequence - 1, sent_ns - 1))
        lost = sequence - last_sequence - 1
        if lost < 0 and sent_ns <= last_sent_ns:
            return  # once more, for example after the router was started again
        last[gid] = sequence, sent_ns
        if len(last) > ENDED_PUBLISHERS_KEPT:
            del last[next(iter(last))]  # of the one that was heard first
        node = self._nodes.get(gid) or gid.hex()
        take(data, is_static, node, max(sent_ns, 0), lost if 0 < lost < MOST_LOST else 0, gid)


class _Announcement(NamedTuple):
    token: zenoh.LivelinessToken  # ends with this object
    gid: bytes


class _ZenohSender:
    def __init__(self, publisher: Any, announcement: _Announcement, where: str) -> None:
        self._publisher, self._announcement, self._where = publisher, announcement, where
        self._lock = threading.RLock()  # messages leave in the order of their sequence numbers
        self._sequence = 0

    def send(self, data: bytes) -> None:
        with self._lock, _errors(self._where):
            self._sequence += 1
            gid = self._announcement.gid
            attached = ATTACHMENT.pack(self._sequence, time.time_ns(), GID_BYTES, gid)
            self._publisher.put(data, attachment=attached)


@contextmanager
def _errors(where: str) -> Iterator[None]:
    try:
        yield
    except zenoh.ZError as error:
        raise ConnectionError(f"{where}: Zenoh failed: {error}") from None


def _gid(token: str) -> bytes:
    """The gid of a publisher: the hash of its token, as a little-endian number."""
    return bytes(xxh3_128_digest(token.encode()))[::-1]


def _publisher_of(token: str) -> _Publisher | None:
    """Read the token of a publisher; None: it is not of rmw_zenoh."""
    match token.split("/"):
        case [_, domain, session, _, _, _, _, namespace, name, topic, type_name, type_hash, qos]:
            node = f"{namespace.replace('%', '/').rstrip('/')}/{name}"
            return _Publisher(domain, session, node, topic.replace("%", "/"), type_name, type_hash, qos)
    return None


def _misfit(publisher: _Publisher, is_static: bool) -> str:
    """Why nothing is received from a publisher, as what follows its name."""
    if publisher.type != TYPE:
        return f"publishes it as {publisher.type}"
    if publisher.type_hash not in (TYPE_HASH, NO_HASH):
        return f"publishes it with type hash {publisher.type_hash}, and this feed reads {TYPE_HASH}"
    if is_static and publisher.qos.split(":")[1:2] != [TRANSIENT_LOCAL]:
        return "publishes it volatile, so it is not latched"
    return "publishes it, but has sent nothing"
