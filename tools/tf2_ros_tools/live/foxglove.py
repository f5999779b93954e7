"""Receive transforms from a robot with foxglove_bridge, with websockets."""

import json
import logging
import queue
import socket
import struct
import threading
from typing import Any, NamedTuple

from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from tf2_ros_tools.live.wire import Address, End, Publisher, Sender, Take, refuse_options

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
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self._connection: ClientConnection | None = None  # None also while there is none
        self._channels: dict[int, _Channel] = {}  # by their numbers
        self._has_warned = False

    def open(self, take: Take, end: End) -> None:
        first: queue.SimpleQueue[Exception | None] = queue.SimpleQueue()
        self._thread = threading.Thread(
            target=self._run, args=(take, end, first), name=self._address.where, daemon=True
        )
        self._thread.start()
        if (error := first.get()) is not None:
            raise ConnectionError(
                f"connect: no bridge answers at {self._url}. Start it on the robot with ros2 launch "
                f"foxglove_bridge foxglove_bridge_launch.xml, or check the address: {error}"
            ) from None

    def close(self) -> None:
        self._closing.set()
        connection = self._connection
        if connection is not None:
            connection.close()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()

    def publishers(self) -> list[Publisher]:
        return [
            Publisher(topic, "", f"{one.schema} in {one.encoding}")
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
            return f"the bridge has {topic} as {channels[0].schema} in {channels[0].encoding}, {is_read}"
        return f"the bridge has {topic}, but has sent nothing"

    def sender(self, topic: str, is_static: bool) -> Sender:
        text = "this feed only receives from foxglove_bridge; to send, connect over zenoh:// or dds://"
        raise ConnectionError(f"{self._address.where}: {text}")

    def _run(self, take: Take, end: End, first: "queue.SimpleQueue[Exception | None]") -> None:
        has_connected = False
        while not self._closing.is_set():
            try:
                with self._connect() as connection:
                    if connection.subprotocol is None:
                        raise WebSocketException("it does not speak Foxglove's protocol")
                    self._connection = connection
                    if self._closing.is_set():
                        return
                    if not has_connected:
                        first.put(None)
                        has_connected = True
                    for message in connection:
                        if self._closing.is_set():
                            return
                        self._handle(connection, message, take, end)
            except (OSError, WebSocketException) as error:
                if not has_connected:
                    first.put(error)
                    return
                log.info(f"{self._address.where}: {error}")
            finally:
                self._connection = None
                self._channels.clear()
            self._closing.wait(RETRY_S)

    def _connect(self) -> ClientConnection:
        # Its own socket, because a robot is not behind the proxy of the environment.
        own = socket.create_connection((self._address.host, self._address.port or PORT), OPEN_S)
        own.settimeout(None)
        return connect(
            self._url,
            sock=own,
            subprotocols=PROTOCOLS,
            compression=None,
            max_size=None,
            open_timeout=OPEN_S,
            close_timeout=CLOSE_S,
        )

    def _handle(self, connection: ClientConnection, message: str | bytes, take: Take, end: End) -> None:
        try:
            if isinstance(message, str):
                self._note(connection, json.loads(message), end)
            elif message[:1] == IS_DATA:
                _, number, received_ns = DATA.unpack_from(message)
                is_static = self._channels[number].topic == self._address.topics[1]
                take(memoryview(message)[DATA.size :], is_static, "", received_ns)
        except (ValueError, LookupError, TypeError, struct.error) as error:
            if not self._has_warned:
                self._has_warned = True
                log.warning(
                    f"{self._address.where}: ignoring a message that is not in Foxglove's protocol: {error!r}"
                )

    def _note(self, connection: ClientConnection, news: Any, end: End) -> None:
        """Note which channels there are, and subscribe to those of the two topics."""
        if news["op"] == "unadvertise":
            for number in news["channelIds"]:
                self._channels.pop(number, None)
        if news["op"] != "advertise":
            return
        wanted = []
        for one in news["channels"]:
            number, topic = int(one["id"]), one["topic"]
            if topic == CLOCK:
                end("/clock is published, and simulated time is not supported")
            if topic in self._address.topics:
                self._channels[number] = _Channel(topic, one["encoding"], one["schemaName"])
                if self._channels[number].is_read:
                    wanted.append({"id": number, "channelId": number})
        if wanted:
            connection.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def _channels_of(self, topic: str) -> list[_Channel]:
        return [one for one in list(self._channels.values()) if one.topic == topic]
