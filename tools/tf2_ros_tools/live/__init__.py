# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
A robot's transforms on a machine without ROS 2, over DDS, Zenoh or foxglove_bridge, in both directions.

>>> from tf2_ros_tools.live import connect
>>> def follow(where):
...     with connect(where) as robot:
...         robot.wait_until_heard(5.0)
...         return robot.buffer.lookup_transform("map", "base_link", 0, timeout=1.0)
"""

from tf2_ros import Buffer
from tf2_ros.records import Recording
from tf2_ros_tools.common.optional_libraries import require
from tf2_ros_tools.live.address import EXAMPLES, Address, parse
from tf2_ros_tools.live.broadcaster import Broadcaster, StaticBroadcaster
from tf2_ros_tools.live.feed import Feed, Heard
from tf2_ros_tools.live.transport import Publisher, Wire

__all__ = ["Broadcaster", "Feed", "Heard", "Publisher", "StaticBroadcaster", "connect"]


def connect(
    where: str,
    *,
    domain: int | None = None,
    buffer: Buffer | None = None,
    topic: str = "/tf",
    static_topic: str = "/tf_static",
    prefix: str = "",
    recording: Recording | None = None,
) -> Feed:
    """
    Receive the transforms of a robot.

    :param where: ``dds://``, ``dds://?peers=192.168.0.7`` (or several, with commas), ``zenoh://robot:7447``
        or ``ws://robot:8765``.
    :param domain: the ROS domain, 0 to 232. None: the environment variable ROS_DOMAIN_ID, or 0.
    :param buffer: the buffer to fill. None: a new ``Buffer``.
    :param topic: the topic of dynamic transforms.
    :param static_topic: the topic of static transforms.
    :param prefix: put before all frame names that arrive, such as ``"robot1/"``.
    :param recording: records who sent which transform when.
    :return: a feed, which receives until it is closed; its attribute ``buffer`` is the buffer.
    :raises TypeError: ``where`` or ``prefix`` is not a str.
    :raises ValueError: the address, the domain, the prefix or the name of a topic is invalid.
    :raises ConnectionError: nothing answers at the address, or DDS cannot start; the text says what to do.
        With ``dds://``, it is not an error if no robot runs yet.
    :raises ModuleNotFoundError: the library for this transport is not installed; the text says how to install
        it.
    """
    address = parse(where, domain, (topic, static_topic))
    wire = _wire_of(address)
    return Feed(buffer, name=where, topics=address.topics, prefix=prefix, wire=wire, recording=recording)


def _wire_of(address: Address) -> Wire:
    # A program needs the library of its wire only.
    if address.scheme == "dds":
        # There, pip installs nothing or fails.
        advice = "; PyPI lacks it for Python 3.14 and for Linux on ARM: use ws:// and foxglove_bridge there"
        require("cyclonedds", "dds", advice)
        from tf2_ros_tools.live.dds import DdsWire

        return DdsWire(address)
    if address.scheme == "zenoh":
        require("zenoh", "zenoh")
        require("xxhash", "zenoh")
        from tf2_ros_tools.live.zenoh import ZenohWire

        return ZenohWire(address)
    if address.scheme == "ws":
        require("websockets", "foxglove")
        from tf2_ros_tools.live.foxglove import FoxgloveWire

        return FoxgloveWire(address)
    raise ValueError(f"expected an address such as {EXAMPLES}, got {address.where!r}")
