# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Receive transforms from a robot with foxglove_bridge, with websockets."""

import json
import logging
import queue
import socket
import struct
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from typing import NamedTuple

from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from tf2_py.printable import printable
from tf2_ros_tools.live.address import Address, refuse_options
from tf2_ros_tools.live.transport import End, Publisher, Sender, Take, WireThread

log = logging.getLogger("tf2_ros_tools.live")

PORT = 8765
# The current protocol, and what bridges before 2025 speak; what is used here is the same in both.
PROTOCOLS = [Subprotocol("foxglove.sdk.v1"), Subprotocol("foxglove.websocket.v1")]
ENCODING, SCHEMA = "cdr", "tf2_msgs/msg/TFMessage"
OPEN_S = 5.0
CLOSE_S = 1.0
RETRY_S = 1.0  # from a failure to the next attempt to connect
# In front of a message: what it is, the number of the subscription, and when the bridge received it in ns.
DATA = struct.Struct("<BIQ")
IS_DATA = b"\x01"
CLOCK = "/clock"


class _Channel(NamedTuple):
    topic: str
    encoding: str
    schema: str

    @property
    def is_read(self) -> bool:
        return (self.encoding, self.schema) == (ENCODING, SCHEMA)

    @property
    def form(self) -> str:
        """Its type and encoding, for texts: the bridge chooses both."""
        return printable(f"{self.schema} in {self.encoding}")


class FoxgloveWire:
    """Receives what a bridge receives. A thread takes what arrives, and connects again after a failure."""

    counts_losses = False

    def __init__(self, address: Address) -> None:
        if not address.host:
            raise ValueError(f"{address.where}: expected the host of a bridge, as in ws://robot:{PORT}")
        refuse_options(address)
        self._address = address
        host = f"[{address.host}]" if ":" in address.host else address.host
        self._url = f"ws://{host}:{address.port or PORT}"
        self._is_closed = False
        self._waking: queue.SimpleQueue[None] = queue.SimpleQueue()  # ends a wait for the next attempt
        self._thread: WireThread | None = None
        self._socket: socket.socket | None = None
        self._connection: ClientConnection | None = None  # None also while there is none
        self._channels: dict[int, _Channel] = {}  # by their numbers
        self._has_warned = False

    def open(self, take: Take, end: End) -> None:
        try:
            connected = self._connect()
        except Exception as error:  # anything may answer there
            raise ConnectionError(
                f"connect: no bridge answers at {self._url}. Start it on the robot with ros2 launch "
                f"foxglove_bridge foxglove_bridge_launch.xml, or check the address: {error}"
            ) from None
        receive = partial(self._run, connected, take, end)
        self._thread = WireThread(self._address.where, receive, end)

    def close(self) -> None:
        self._is_closed = True
        self._waking.put(None)
        # Not `close` of the connection, which waits for a bridge that does not read.
        _shut_down(self._socket)
        if self._thread is not None:
            WireThread.wait_for([self._thread])

    def publishers(self) -> list[Publisher]:
        return [
            Publisher(topic, "", one.form)
            for topic in self._address.topics
            for one in self._channels_of(topic)
        ]

    def why_silent(self, topic: str, seconds: float) -> str:
        if self._connection is None:
            return f"{self._url} no longer answers"
        channels = self._channels_of(topic)
        if not channels:
            return (
                f"the bridge has no {topic}: no node publishes it, or the bridge's topic_whitelist lacks it"
            )
        if not any(one.is_read for one in channels):
            is_read = f"but this feed reads only {SCHEMA} in {ENCODING}"
            return f"the bridge has {topic} as {channels[0].form}, {is_read}"
        return f"the bridge has {topic}, but has sent nothing"

    def sender(self, topic: str, is_static: bool) -> Sender:
        text = "this feed only receives from foxglove_bridge; to send, connect over zenoh:// or dds://"
        raise ConnectionError(f"{self._address.where}: {text}")

    def _run(self, connected: ExitStack | None, take: Take, end: End) -> None:
        while not self._is_closed:
            try:
                with connected or self._connect():
                    assert self._connection is not None
                    for message in self._connection:
                        if self._is_closed:
                            return
                        if isinstance(message, str):
                            self._note(self._connection, message, end)
                        elif message[:1] == IS_DATA:
                            self._take(message, take)
            except Exception as error:  # another program may answer by now
                log.info(f"{self._address.where}: {error}")
            finally:
                connected = self._connection = None
                self._channels.clear()
            with suppress(queue.Empty):
                self._waking.get(timeout=RETRY_S)

    def _channels_of(self, topic: str) -> list[_Channel]:
        return [one for one in list(self._channels.values()) if one.topic == topic]

    def _connect(self) -> ExitStack:
        """Connect, until the result is closed."""
        with ExitStack() as stack:
            # Its own socket, because a robot is not behind the proxy of the environment.
            address = self._address.host, self._address.port or PORT
            own = stack.enter_context(socket.create_connection(address, OPEN_S))
            stack.callback(_shut_down, own)
            own.settimeout(None)
            self._socket = own
            if self._is_closed:  # before it could shut the socket down
                raise ConnectionError("the feed was closed")
            self._connection = stack.enter_context(
                connect(
                    self._url,
                    sock=own,
                    subprotocols=PROTOCOLS,
                    compression=None,
                    max_size=None,
                    open_timeout=OPEN_S,
                    close_timeout=CLOSE_S,
                )
            )
            # Is done first, because websockets would wait for a bridge that does not read.
            stack.callback(_shut_down, own)
            if self._connection.subprotocol is None:
                raise WebSocketException("it does not speak Foxglove's protocol")
            return stack.pop_all()

    def _take(self, message: bytes, take: Take) -> None:
        with self._ignoring():
            _, number, received_ns = DATA.unpack_from(message)
            is_static = self._channels[number].topic == self._address.topics[1]
            take(memoryview(message)[DATA.size :], is_static, "", received_ns)

    def _note(self, connection: ClientConnection, message: str, end: End) -> None:
        """Note which channels there are, and subscribe to those of the two topics."""
        wanted = []
        with self._ignoring():
            news = json.loads(message)
            if news["op"] == "unadvertise":
                for number in news["channelIds"]:
                    self._channels.pop(number, None)
            for one in news["channels"] if news["op"] == "advertise" else []:
                topic = one["topic"]
                if topic == CLOCK:
                    end("/clock is published, and simulated time is not supported")
                if topic in self._address.topics:
                    number, channel = int(one["id"]), _Channel(topic, one["encoding"], one["schemaName"])
                    self._channels[number] = channel
                    if channel.is_read:
                        wanted.append({"id": number, "channelId": number})
        if wanted:
            connection.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    @contextmanager
    def _ignoring(self) -> Iterator[None]:
        """Ignore a message that is not in the protocol, or what follows the first mistake in it."""
        try:
            yield
        except Exception as error:
            if not self._has_warned:
                self._has_warned = True
                log.warning(
                    f"{self._address.where}: ignoring a message that is not in Foxglove's protocol: {error!r}"
                )


def _shut_down(one: socket.socket | None) -> None:
    """End a connection at once, also for a thread that sends or receives, and for forked processes."""
    if one is not None:
        with suppress(OSError):  # it has ended
            one.shutdown(socket.SHUT_RDWR)
