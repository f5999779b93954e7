# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a robot with rmw_zenoh does, but without an rmw; orders as for `robot_with_rclpy.py`."""

import atexit
import itertools
import json
import os
import struct
import threading
import time

import xxhash
import zenoh
from rclpy.serialization import deserialize_message, serialize_message
from robot_with_rclpy import *  # noqa: F403
from robot_with_rclpy import TFMessage, heard, messages, send
from zenoh import ext
from zenoh.handlers import FifoChannel

TYPE = "tf2_msgs::msg::dds_::TFMessage_"
HASH = "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"
DOMAIN = os.environ["ROS_DOMAIN_ID"]
_numbers = itertools.count()
_kept = []


def opened(mode, **endpoints):
    """A session of Zenoh on this machine, without multicast."""
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("scouting/multicast/enabled", "false")
    for key, port in endpoints.items():
        config.insert_json5(f"{key}/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    session = zenoh.open(config)
    atexit.register(session.close)
    return session


def route(port):
    _kept.append(opened("router", listen=port))


def start(port):
    global _session
    _session = opened("client", connect=port)


class Publisher:
    """As rmw_zenoh makes it: Jazzy 0.2.10 was observed."""

    def __init__(
        self, name, topic, *, depth=100, latches=False, domain=DOMAIN, type_name=TYPE, type_hash=HASH
    ):
        zid, eid = _session.info.zid(), next(_numbers)
        node = f"@ros2_lv/{domain}/{zid}/{eid}/{eid}/NN/%/%/{name}"
        qos = f":1:,{depth}:,:,:,," if latches else f"::,{depth}:,:,:,,"
        self.token = (
            f"@ros2_lv/{domain}/{zid}/{eid}/{next(_numbers)}/MP/%/%/{name}/"
            f"{topic.replace('/', '%')}/{type_name}/{type_hash}/{qos}"
        )
        self.gid = xxhash.xxh3_128_intdigest(self.token.encode()).to_bytes(16, "little")
        self.sequence = 0
        self._subscriptions = f"@ros2_lv/{domain}/*/*/*/MS/*/*/*/{topic.replace('/', '%')}/**"
        key = f"{domain}{topic}/{type_name}/{type_hash}"
        if latches:
            self._publisher = ext.declare_advanced_publisher(
                _session,
                key,
                congestion_control=zenoh.CongestionControl.BLOCK,
                cache=ext.CacheConfig(depth),
                sample_miss_detection=ext.MissDetectionConfig(sporadic_heartbeat=0.5, heartbeat=None),
                publisher_detection=True,
            )
        else:
            self._publisher = _session.declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP)
        self._tokens = [_session.liveliness().declare_token(one) for one in (node, self.token)]

    def publish(self, message):
        self.sequence += 1
        self.put(message if isinstance(message, bytes) else serialize_message(message))

    def put(self, data, sequence=None, sent_ns=None):
        sequence = self.sequence if sequence is None else sequence
        sent_ns = time.time_ns() if sent_ns is None else sent_ns
        self.put_with(data, struct.pack("<qqB", sequence, sent_ns, 16) + self.gid)

    def put_with(self, data, attachment):
        self._publisher.put(data, attachment=attachment)

    def get_subscription_count(self):
        return len([*_session.liveliness().get(self._subscriptions)])


def publisher(name, topic="/tf", **options):
    _kept.append(Publisher(name, topic, **options))
    return _kept[-1]


def latched(name, *transforms, topic="/tf_static", **options):
    send(publisher(name, topic, depth=1, latches=True, **options), *transforms)


def clock():
    publisher("clock", "/clock", type_name="rosgraph_msgs::msg::dds_::Clock_", type_hash="RIHS01_0")


def listen(type_hash=HASH):
    """Note in `heard` and `messages` what arrives."""

    def note(topic, subscriber):
        for sample in subscriber:
            messages[topic] += 1
            for one in deserialize_message(sample.payload.to_bytes(), TFMessage).transforms:
                heard[topic, one.child_frame_id] = one.transform.translation.x

    keys = [f"{DOMAIN}{topic}/{TYPE}/{type_hash}" for topic in ("/tf", "/tf_static")]
    moving = _session.declare_subscriber(keys[0], FifoChannel(1000))
    fixed = ext.declare_advanced_subscriber(
        _session,
        keys[1],
        FifoChannel(1000),
        history=ext.HistoryConfig(detect_late_publishers=True),
        recovery=ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
    )
    for topic, subscriber, qos in (("/tf", moving, "::,100:,:,:,,"), ("/tf_static", fixed, ":1:,100:,:,:,,")):
        threading.Thread(target=note, args=(topic, subscriber), daemon=True).start()
        atexit.register(subscriber.undeclare)
        node = f"@ros2_lv/{DOMAIN}/{_session.info.zid()}/0/{next(_numbers)}/MS/%/%/listener"
        token = f"{node}/{topic.replace('/', '%')}/{TYPE}/{type_hash}/{qos}"
        _kept.append(_session.liveliness().declare_token(token))
