# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Receive transforms from a robot over DDS, and send some, with Cyclone DDS."""

import os
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from itertools import count
from typing import Any

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsParticipant, BuiltinTopicDcpsPublication
from cyclonedds.builtin_types import DcpsEndpoint
from cyclonedds.core import (
    DDSException,
    GuardCondition,
    InstanceState,
    ReadCondition,
    SampleState,
    ViewState,
    WaitSet,
)
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import make_idl_struct
from cyclonedds.idl.types import array, float64, int32, sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from tf2_ros_tools.common.output import first_names
from tf2_ros_tools.live.address import Address, refuse_options
from tf2_ros_tools.live.transport import DISCOVERY_S, TYPE, End, Publisher, Sender, Take, WireThread

DEPTH = 1000  # messages that wait while Python or the network is busy: 5 s of 200 Hz
TAKEN = 100  # messages, at most, between two looks at whether the wire is closed
TURNS = 100  # messages, at most, between two looks at anything else
FOR_EVER = duration(weeks=1000)
# Type checkers see no generic types there.
_sequence: Any = sequence
_array: Any = array
ANY = ViewState.Any | SampleState.Any | InstanceState.Any
RELIABLE = Policy.Reliability.Reliable(max_blocking_time=duration(seconds=1))
CLOCK = "rt/clock"
# Says which node has which publisher, by their gids: GUIDs, which Humble fills up with zeros.
NODES = "ros_discovery_info"
WIDE_RANGES = "", "SUBNET", "SYSTEM_DEFAULT"  # of ROS_AUTOMATIC_DISCOVERY_RANGE
GUID_BYTES = 16
PREFIX_BYTES = 12  # of a GUID: which participant it is of
GID_BYTES = 16, 24
CDR_HEADER = ALIGNMENT = 4  # bytes
EPROSIMA = "1.15"  # Fast DDS 3, of Kilted, describes types in a way that Cyclone DDS refuses, silently
# The number of a domain within this process. Each wire has another one, because a process can configure each
# only once, and the program may use Cyclone DDS, too. ExternalDomainId is what counts on the network.
_numbers = count(100_000)


def _struct(package: str, name: str, **fields: Any) -> Any:
    return make_idl_struct(name, f"{package}::msg::dds_::{name}_", fields)


def _serialized(struct: Any) -> Any:
    """Make a type whose samples are what is on the network: bytes, as ``data``. Its fields are announced."""

    def __init__(self: Any, data: bytes) -> None:
        self.data = data

    struct.__init__ = __init__
    struct.serialize = lambda self, **_: self.data
    take: Any = lambda cls, data, **_: cls(data)  # noqa: E731  a method
    struct.deserialize = struct.deserialize_key = classmethod(take)
    return struct


_TIME = _struct("builtin_interfaces", "Time", sec=int32, nanosec=uint32)
_HEADER = _struct("std_msgs", "Header", stamp=_TIME, frame_id=str)
_VECTOR = _struct("geometry_msgs", "Vector3", x=float64, y=float64, z=float64)
_QUATERNION = _struct("geometry_msgs", "Quaternion", x=float64, y=float64, z=float64, w=float64)
_TRANSFORM = _struct("geometry_msgs", "Transform", translation=_VECTOR, rotation=_QUATERNION)
_STAMPED = _struct(
    "geometry_msgs", "TransformStamped", header=_HEADER, child_frame_id=str, transform=_TRANSFORM
)
TFMessage = _serialized(_struct("tf2_msgs", "TFMessage", transforms=_sequence[_STAMPED]))
# Only its first bytes, because Cyclone DDS checks what it knows, and Humble's gids are longer.
ParticipantEntities = _serialized(
    _struct("rmw_dds_common", "ParticipantEntitiesInfo", gid=_array[uint8, GUID_BYTES])
)


class DdsWire:
    """Receives from every middleware of ROS 2 that speaks DDS. A thread waits for messages and takes them."""

    counts_losses = False

    def __init__(self, address: Address) -> None:
        if address.host or address.port:
            expected = "give the robot's address as dds://?peers=192.168.0.7, and its domain in ROS_DOMAIN_ID"
            raise ValueError(f"{address.where}: {expected}")
        refuse_options(address, "peers")
        self._address = address
        self._domain: Domain | None = None  # all else in it ends with it
        self._thread: WireThread | None = None
        self._is_closing = False
        self._participants: set[int] = set()  # handles, without ours
        self._publishers: dict[int, DcpsEndpoint] = {}  # by handle, without ours
        # The names of nodes by the GUIDs of their publishers, by the participants that have them.
        self._nodes: dict[bytes, dict[bytes, str]] = {}

    def open(self, take: Take, end: End) -> None:
        self._opened_s = time.monotonic()
        number = next(_numbers)
        try:
            self._domain = Domain(number, _configuration(self._address))
            self._participant = participant = DomainParticipant(number)
            self._closed = GuardCondition(participant)
            self._readers = [
                # What this program sends is inserted by the feed.
                DataReader(
                    participant,
                    Topic(participant, _dds_name(topic), TFMessage),
                    _qos(is_static, DEPTH, Policy.IgnoreLocal.Participant),
                )
                for topic, is_static in zip(self._address.topics, (False, True), strict=True)
            ]
            self._found = BuiltinDataReader(participant, BuiltinTopicDcpsParticipant)
            self._offered = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
            latched = Qos(RELIABLE, Policy.Durability.TransientLocal, Policy.History.KeepAll)
            self._named = DataReader(participant, Topic(participant, NODES, ParticipantEntities), latched)
            self._waits = WaitSet(participant)
            self._waits.attach(self._closed)
            for reader in (self._found, self._offered, self._named, *self._readers):
                self._waits.attach(ReadCondition(reader, ANY))
        except DDSException as error:
            is_set = "; CYCLONEDDS_URI is set" if "CYCLONEDDS_URI" in os.environ else ""
            text = f"Cyclone DDS cannot start (see its output above{is_set}): {error}"
            raise ConnectionError(f"{self._address.where}: {text}") from None
        self._thread = WireThread(self._address.where, partial(self._run, take, end), end)

    def close(self) -> None:
        self._is_closing = True
        if self._thread is None:
            self._domain = None
            return
        with suppress(DDSException):  # the thread has ended already, and all entities with it
            self._closed.set(True)
        WireThread.wait_for([self._thread])

    def publishers(self) -> list[Publisher]:
        return [
            Publisher(topic, self._node_of(one), _described(one), one.key.hex)
            for topic in self._address.topics
            for one in self._publishers_of(topic)
        ]

    def why_silent(self, topic: str, seconds: float) -> str:
        domain = self._address.domain
        if not self._participants:
            return (
                f"no robot was found in domain {domain}{self._so_far()}. Check that its nodes run, "
                "and check ROS_DOMAIN_ID, the robot's ROS_AUTOMATIC_DISCOVERY_RANGE, and the firewall (UDP "
                f"from port {7400 + 250 * domain}). "
                "Without multicast, give the robot's address: dds://?peers=192.168.0.7"
            )
        publishers = self._publishers_of(topic)
        is_static = topic == self._address.topics[1]
        silent = f"publishes it, but has sent nothing{self._so_far()}"
        reasons = [
            f"{self._node_of(one) or one.key} {_misfit(one, is_static) or silent}" for one in publishers
        ]
        return first_names(reasons) or f"no node publishes {topic} in domain {domain}{self._so_far()}"

    def _so_far(self) -> str:
        is_early = time.monotonic() - self._opened_s < DISCOVERY_S
        return f" so far, and discovery takes up to {DISCOVERY_S:g} s" if is_early else ""

    def sender(self, topic: str, is_static: bool) -> Sender:
        # A late listener needs only the last message of static transforms, because it contains all of them.
        qos = _qos(is_static, 1 if is_static else DEPTH)
        return _DdsSender(self._participant, topic, qos, self._address.where)

    def _run(self, take: Take, end: End) -> None:
        try:
            for turn in count():
                self._waits.wait(FOR_EVER)
                if self._is_closing:
                    return
                # At hundreds of messages a second, further calls would cost as much as a message.
                if not self._take(False, take, end) or turn % TURNS == 0:
                    self._look_around(end)
                    self._take(True, take, end)
        finally:
            self._domain = None

    def _take(self, is_static: bool, take: Take, end: End) -> bool:
        """Hand over messages; return whether there was anything."""
        samples = self._readers[is_static].take(TAKEN)
        for sample in samples:
            if self._is_closing:
                break
            info = sample.sample_info
            if not info.valid_data:  # the news that a publisher has ended
                continue
            if info.publication_handle not in self._publishers:
                self._look_around(end)
            publisher = self._publishers.get(info.publication_handle)
            name = "" if publisher is None else self._node_of(publisher) or publisher.key.hex
            gid = b"" if publisher is None else publisher.key.bytes
            take(sample.data, is_static, name, info.source_timestamp, 0, gid)
        return bool(samples)

    def _look_around(self, end: End) -> None:
        """Note who is there."""
        self._note_participants()
        self._note_publishers(end)
        for sample in self._named.take(TAKEN):
            if sample.sample_info.valid_data:
                participant = sample.data[CDR_HEADER:][:PREFIX_BYTES]
                self._nodes[participant] = nodes_of_publishers(sample.data)

    def _note_participants(self) -> None:
        for found in self._found.take(TAKEN):
            handle = found.sample_info.instance_handle
            if found.sample_info.instance_state != InstanceState.Alive:
                self._participants.discard(handle)
                self._nodes.pop(found.key.bytes[:PREFIX_BYTES], None)
            elif found.key != self._participant.guid:
                self._participants.add(handle)

    def _note_publishers(self, end: End) -> None:
        for found in self._offered.take(TAKEN):
            handle = found.sample_info.instance_handle
            if found.sample_info.instance_state != InstanceState.Alive:
                self._publishers.pop(handle, None)
            elif found.participant_key != self._participant.guid:
                if found.topic_name in map(_dds_name, self._address.topics):
                    self._publishers[handle] = found
                elif found.topic_name == CLOCK:
                    end("/clock is published, and simulated time is not supported")

    def _publishers_of(self, topic: str) -> list[DcpsEndpoint]:
        return [one for one in list(self._publishers.values()) if one.topic_name == _dds_name(topic)]

    def _node_of(self, publisher: DcpsEndpoint) -> str:
        guid = publisher.key.bytes
        return self._nodes.get(guid[:PREFIX_BYTES], {}).get(guid, "")


class _DdsSender:
    def __init__(self, participant: DomainParticipant, topic: str, qos: Qos, where: str) -> None:
        self._where = where
        with self._errors():
            self._writer = DataWriter(participant, Topic(participant, _dds_name(topic), TFMessage), qos)

    def send(self, data: bytes) -> None:
        with self._errors():
            self._writer.write(TFMessage(data))

    @contextmanager
    def _errors(self) -> Iterator[None]:
        try:
            yield
        except DDSException as error:
            raise ConnectionError(f"{self._where}: sending failed: {error.msg}") from None


def _dds_name(topic: str) -> str:
    return f"rt{topic}"


def _qos(is_static: bool, depth: int, *others: Any) -> Qos:
    durability = Policy.Durability.TransientLocal if is_static else Policy.Durability.Volatile
    return Qos(RELIABLE, durability, Policy.History.KeepLast(depth), *others)


def _described(publisher: DcpsEndpoint) -> str:
    qos = publisher.qos
    reliability = "best-effort" if Policy.Reliability.BestEffort in qos else "reliable"
    durability = "volatile" if Policy.Durability.Volatile in qos else "transient local"
    return f"{reliability}, {durability}"


def _misfit(publisher: DcpsEndpoint, is_static: bool) -> str:
    """Why nothing can be received from a publisher, as what follows its name; ``""`` if something can."""
    if publisher.type_name != TYPE:
        return f"publishes it as {publisher.type_name}"
    if Policy.Reliability.BestEffort in publisher.qos:
        return "publishes it best-effort, and listeners require reliable"
    if is_static and Policy.Durability.Volatile in publisher.qos:
        return "publishes it volatile, so it is not latched, and listeners require transient local"
    return ""


def _configuration(address: Address) -> str:
    """The configuration of Cyclone DDS, as the middlewares of ROS 2 understand the environment."""
    ignores_others = os.environ.get("ROS_LOCALHOST_ONLY") == "1"  # as rcl does
    discovery = "LOCALHOST" if ignores_others else os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").upper()
    if discovery == "OFF":
        raise ConnectionError(
            f"{address.where}: ROS_AUTOMATIC_DISCOVERY_RANGE is OFF, so nothing can be found"
        )
    # As in ROS 2, an unknown range is this machine.
    is_local = discovery not in WIDE_RANGES
    peers = address.options.get("peers", "").split(",")
    peers += [] if ignores_others else os.environ.get("ROS_STATIC_PEERS", "").split(";")
    peers += ["127.0.0.1"] if is_local else []
    addresses = [_resolved(peer, address.where) for peer in peers if peer.strip()]
    # A robot that begins later learns of this program by being asked.
    asking = "<SPDPInterval>1s</SPDPInterval><InitialLocatorPruneDelay>inf</InitialLocatorPruneDelay>"
    listed = "".join(f'<Peer Address="{one}"/>' for one in addresses)
    own = f"""<CycloneDDS><Domain Id="any">
        {"<General><AllowMulticast>false</AllowMulticast></General>" if is_local else ""}
        <Discovery>
            <ExternalDomainId>{address.domain}</ExternalDomainId>
            {f"{asking}<Peers>{listed}</Peers>" if addresses else ""}
        </Discovery>
        <Compatibility><IgnoreTypeInformation>{EPROSIMA}</IgnoreTypeInformation></Compatibility>
    </Domain></CycloneDDS>"""
    # Later ones add to earlier ones.
    return ",".join(filter(None, (os.environ.get("CYCLONEDDS_URI"), own)))


def _resolved(peer: str, where: str) -> str:
    """The address of a host. Cyclone DDS aborts the process if it finds none."""
    try:
        return str(socket.getaddrinfo(peer.strip(), None, socket.AF_INET)[0][4][0])
    except (OSError, UnicodeError):
        raise ConnectionError(f"{where}: the peer {peer!r} has no IPv4 address") from None


def nodes_of_publishers(data: bytes) -> dict[bytes, str]:
    """The names of the nodes in a message of NODES, by the GUIDs of their publishers; empty if malformed."""
    for gid_bytes in GID_BYTES:
        with suppress(struct.error, UnicodeDecodeError):
            return dict(_read_nodes(data, gid_bytes))
    return {}


def _read_nodes(data: bytes, gid_bytes: int) -> Iterator[tuple[bytes, str]]:
    order = "<" if data[1:2] == b"\1" else ">"
    at = CDR_HEADER + gid_bytes  # of the participant

    def read(layout: str) -> Any:
        nonlocal at
        (value,) = struct.unpack_from(layout, data, at)
        at += struct.calcsize(layout)
        return value

    def number() -> int:
        nonlocal at
        at += -at % ALIGNMENT
        return int(read(f"{order}I"))

    def text() -> str:
        return str(read(f"{number()}s")[:-1].decode())  # without the NUL

    for _ in range(number()):
        node = f"{text().rstrip('/')}/{text()}"
        read(f"{number() * gid_bytes}s")  # its subscriptions
        for _ in range(number()):
            yield read(f"{gid_bytes}s")[:GUID_BYTES], node
    if at != len(data):
        raise struct.error("bytes are left")
