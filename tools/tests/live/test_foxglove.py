# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A robot with foxglove_bridge: a server of foxglove-sdk in one process, and in another one no ROS."""

import base64
import hashlib
import json
import socket
import struct
import threading
from contextlib import contextmanager

import pytest
from obeying_processes import Obeying, OrderError
from rclpy.serialization import serialize_message
from robot_with_rclpy import made
from shared_feed_tests import check_exit, why
from waiting import DEADLINE_S, until

from tf2_msgs.msg import TFMessage
from tf2_ros_tools.live import connect

pytest.importorskip("websockets")

from websockets.sync.server import serve

SECONDS = DEADLINE_S
SCHEMA = "tf2_msgs/msg/TFMessage"


def message(parent, *children, x=1.0):
    return serialize_message(TFMessage(transforms=[made(parent, child, x, 10**9) for child in children]))


CAMERA, BASE = message("base", "camera").hex(), message("map", "base", x=2.0).hex()
MANY = message("map", *(f"f{n}" for n in range(50))).hex()


@pytest.fixture
def new_bridge(processes, port):
    pytest.importorskip("foxglove")

    def make():
        processes.append(Obeying("robot_with_foxglove"))
        processes[-1].do(f"from robot_with_foxglove import *; start({port})")
        return processes[-1]

    return make


@pytest.fixture
def bridge(new_bridge):
    return new_bridge()


@pytest.fixture
def new_laptop(processes, port):
    def make(options="", connects=True):
        processes.append(Obeying("without_rclpy", "run_by_laptop", "tf2_ros_tools.live.foxglove"))
        laptop = processes[-1]
        laptop.do("from run_by_laptop import *")
        if connects:
            laptop.do(f"robot = connect('ws://127.0.0.1:{port}', {options})")
        return laptop

    return make


@pytest.fixture
def laptop(bridge, new_laptop):
    """For tests without a topic: the server loses what begins while a client connects."""
    return new_laptop()


def test_a_late_joiner_has_what_the_bridge_retains(bridge, new_laptop):
    bridge.do("offer('/tf_static'); offer('/tf'); offer('/other')")
    bridge.do(f"send('/tf_static', '{CAMERA}', latches=True)")
    laptop = new_laptop()
    laptop.until("robot.topics['/tf_static'].count == 1")
    bridge.until("channels['/tf'].has_sinks()")
    bridge.do(f"send('/tf', '{BASE}')")
    laptop.do(f"robot.wait_until_heard({SECONDS})")
    assert laptop.do("seen(robot, 'map', 'camera')") == 3
    assert laptop.do("heard(robot)") == [[1, None, 0], [1, None, 0]]
    assert laptop.do("[one[:3] for one in robot.publishers()]") == [
        [topic, "", f"{SCHEMA} in cdr"] for topic in ("/tf", "/tf_static")
    ]
    assert 0 <= laptop.do("robot.clock_offset") < SECONDS


def test_a_topic_that_begins_later_and_begins_again(bridge, new_laptop):
    # Once the server has read a subscription, it tells the laptop of others; not of what begins just before.
    bridge.do("offer('/tf_static')")
    laptop = new_laptop()
    bridge.until("channels['/tf_static'].has_sinks()")
    for n in range(3):
        bridge.do("offer('/tf')")
        while not bridge.do("has_client('/tf')"):
            bridge.do("channels.pop('/tf').close(); offer('/tf')")  # the server loses some under load
        bridge.do(f"send('/tf', '{BASE}')")
        laptop.until(f"robot.topics['/tf'].count == {n + 1}")
        bridge.do("channels.pop('/tf').close()")
        laptop.until("len(robot.publishers()) == 1")


def test_other_topics_and_a_prefix(bridge, new_laptop):
    bridge.do(
        "offer('/robot1/tf'); offer('/robot1/tf_static'); "
        f"send('/robot1/tf_static', '{CAMERA}', latches=True)"
    )
    laptop = new_laptop("topic='robot1/tf', static_topic='/robot1/tf_static', prefix='robot1/'")
    bridge.until("channels['/robot1/tf'].has_sinks()")
    bridge.do(f"send('/robot1/tf', '{BASE}')")
    laptop.until("robot.buffer.can_transform('robot1/map', 'robot1/camera', 0)")


def test_nothing_is_lost_while_a_call_holds_the_gil(bridge, new_laptop):
    bridge.do("offer('/tf')")
    laptop = new_laptop()
    bridge.until("channels['/tf'].has_sinks()")
    bridge.do(f"send('/tf', '{MANY}', 600, 200)")
    laptop.until("robot.topics['/tf'].count > 0")
    laptop.do("hold_gil(2)")
    laptop.until("robot.topics['/tf'].count >= 600")
    assert laptop.do("heard(robot)[0]") == [600, None, 0]


def test_a_bridge_that_is_killed_and_started_again(new_bridge, new_laptop, port):
    bridge = new_bridge()
    bridge.do(f"offer('/tf_static'); send('/tf_static', '{CAMERA}', latches=True)")
    laptop = new_laptop()
    laptop.until("robot.topics['/tf_static'].count == 1")
    bridge.kill()
    laptop.until("robot.publishers() == []")
    with pytest.raises(OrderError, match=f": ws://127.0.0.1:{port} no longer answers$"):
        laptop.do("robot.wait_until_heard(0.1)")
    new_bridge().do(f"offer('/tf_static'); offer('/tf'); send('/tf_static', '{CAMERA}', latches=True)")
    laptop.until("robot.topics['/tf_static'].count == 2")


# Why nothing arrives.


def test_nothing_answers(new_laptop, port):
    laptop = new_laptop(connects=False)
    with pytest.raises(OrderError) as raised:
        laptop.do(f"connect('ws://127.0.0.1:{port}')")
    assert str(raised.value).startswith(
        f"ConnectionError: connect: no bridge answers at ws://127.0.0.1:{port}. Start it on the "
        "robot with ros2 launch foxglove_bridge foxglove_bridge_launch.xml, or check the address: "
    )


def test_something_else_answers(new_laptop, port):
    laptop = new_laptop(connects=False)
    with serve(lambda connection: connection.recv(), "127.0.0.1", port) as server:
        threading.Thread(target=server.serve_forever).start()
        with pytest.raises(OrderError, match="no bridge answers .* it does not speak Foxglove's protocol$"):
            laptop.do(f"connect('ws://127.0.0.1:{port}')")


def test_a_bridge_without_the_topics(laptop):
    text = "no node publishes it, or the bridge's topic_whitelist lacks it"
    assert why(laptop) == (
        "TimeoutError: nothing has been received on /tf or /tf_static in 0.5 s: the bridge has no /tf: "
        f"{text}; the bridge has no /tf_static: {text}"
    )


def test_a_bridge_that_does_not_send_the_right_messages(bridge, new_laptop):
    bridge.do("offer('/tf', 'tf2_msgs/TFMessage', 'ros1'); offer('/tf_static')")
    laptop = new_laptop()
    laptop.until("len(robot.publishers()) == 2")
    assert why(laptop) == (
        "TimeoutError: nothing has been received on /tf or /tf_static in 0.5 s: the bridge has /tf as "
        f"tf2_msgs/TFMessage in ros1, but this feed reads only {SCHEMA} in cdr; the bridge has /tf_static, "
        "but has sent nothing"
    )


def test_simulated_time_is_refused(bridge, new_laptop, port):
    bridge.do("offer('/clock', 'rosgraph_msgs/msg/Clock')")
    laptop = new_laptop()
    text = "/clock is published, and simulated time is not supported"
    with pytest.raises(OrderError, match=f"^ConnectionError: ws://127.0.0.1:{port} has ended.*{text}"):
        laptop.do(f"robot.wait_until_heard({SECONDS})")


@pytest.mark.parametrize("kind", ["broadcaster", "static_broadcaster"])
def test_it_only_receives(laptop, port, kind):
    with pytest.raises(OrderError) as raised:
        laptop.do(f"robot.{kind}()")
    assert str(raised.value) == (
        f"ConnectionError: ws://127.0.0.1:{port}: this feed only receives from foxglove_bridge; to send, "
        "connect over zenoh:// or dds://"
    )


# Bytes that no bridge sends.

ADVERTISED = {"id": 7, "topic": "/tf", "encoding": "cdr", "schemaName": SCHEMA, "schema": ""}


def test_damaged_messages(port, caplog):
    good = struct.pack("<BIQ", 1, 7, 10**9) + bytes.fromhex(BASE)
    advertisement = json.dumps({"op": "advertise", "channels": [ADVERTISED]})
    damaged = ["", "[]", "{", "7", "null", '{"op": "advertise"}', '{"op": "advertise", "channels": [7]}']
    damaged += [
        '{"op": "unadvertise"}',
        '{"op": "unadvertise", "channelIds": [[]]}',
        '{"op": []}',
        '{"op": "new"}',
    ]
    damaged += [
        b"",
        b"\x01",
        b"\x02",
        good[:9],
        good[:13],
        good[:-1],
        b"\x01\x08" + good[2:],
        b"\x05" + good[1:],
    ]
    damaged += [json.dumps({"op": "advertise", "channels": [ADVERTISED | {key: []}]}) for key in ADVERTISED]
    damaged += ["[" * 100_000, advertisement.replace("7", "1e999"), advertisement.replace("7", "7" * 5000)]
    subscribed = []

    def handler(connection):
        for one in damaged:
            connection.send(one)
        connection.send(advertisement)
        subscribed.append(json.loads(connection.recv()))
        for one in [*damaged, good, good]:
            connection.send(one)
        for _ in connection:  # until the laptop ends
            pass

    with serve(handler, "127.0.0.1", port, subprotocols=["foxglove.websocket.v1"]) as server:
        threading.Thread(target=server.serve_forever).start()
        with connect(f"ws://127.0.0.1:{port}") as feed:
            until(lambda: feed.topics["/tf"].count == 2)
            assert feed.topics["/tf"].malformed == 2
            assert feed.buffer.can_transform("map", "base", 0)
    assert {"op": "subscribe", "subscriptions": [{"id": 7, "channelId": 7}]} in subscribed
    assert (
        sum("ignoring a message that is not in Foxglove's protocol" in one.message for one in caplog.records)
        == 1
    )


@contextmanager
def answering(answer):
    """A server that sends this for the first request, then does what `answer` does; its address."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def run():
            one, _ = server.accept()
            with one:
                request = one.recv(10_000).decode()
                answer(one, request)

        thread = threading.Thread(target=run)
        thread.start()
        yield f"ws://127.0.0.1:{server.getsockname()[1]}"
        thread.join()


@pytest.mark.parametrize(
    "answer",
    [
        "HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n",
        "HTTP/1.1 302 Found\r\nLocation: /login\r\nContent-Length: 0\r\n\r\n",
        "HTTP/1.1 302 Found\r\nLocation: https://127.0.0.1/\r\nContent-Length: 0\r\n\r\n",
        "HTTP/1.1 302 Found\r\nLocation: http://[\r\nContent-Length: 0\r\n\r\n",
        "HTTP/1.1 101 Switching Protocols\r\n\r\n",
        "SSH-2.0-OpenSSH_9.6\r\n",
        "",
    ],
)
def test_connecting_to_another_server_is_an_error(answer):
    with answering(lambda one, _: one.sendall(answer.encode())) as where:
        with pytest.raises(
            ConnectionError, match=f"^connect: no bridge answers at {where}. Start it on the robot"
        ):
            connect(where)


@pytest.mark.parametrize("host", ["a..b", "robot.invalid", "a" * 64, "."])
def test_hosts_without_an_address(host):
    with pytest.raises(ConnectionError, match=f"^connect: no bridge answers at ws://{host}:8765. Start it"):
        connect(f"ws://{host}")


def test_a_feed_closes_while_the_bridge_pings_and_never_reads():
    def ping(one, request):
        [key] = [
            line.split()[1] for line in request.split("\r\n") if line.lower().startswith("sec-websocket-key")
        ]
        digest = hashlib.sha1((key + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11").encode()).digest()
        head = "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        accept = f"Sec-WebSocket-Accept: {base64.b64encode(digest).decode()}\r\n"
        one.sendall(f"{head}{accept}Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n".encode())
        one.settimeout(1.0)  # the laptop reads no more, because it cannot write
        try:
            while True:
                one.sendall(100 * (b"\x89\x7d" + bytes(125)))
        except TimeoutError:
            pings_for_nothing.set()
        with pytest.raises(OSError):
            one.settimeout(None)
            while True:
                one.sendall(b"\x89\x00")

    pings_for_nothing = threading.Event()
    with answering(ping) as where, connect(where) as feed:
        assert pings_for_nothing.wait(SECONDS)
        closing = threading.Thread(target=feed.close, daemon=True)
        closing.start()
        closing.join(SECONDS)
        assert not closing.is_alive()


def test_a_callback_that_exits_ends_the_feed(bridge, new_laptop):
    bridge.do("offer('/tf')")
    laptop = new_laptop()
    bridge.until("channels['/tf'].has_sinks()")
    check_exit(laptop, lambda: bridge.do(f"send('/tf', '{BASE}')"))


@pytest.mark.parametrize("closer", ["a thread", "a callback"])
def test_a_feed_closes_while_messages_arrive(bridge, new_laptop, port, closer):
    laptop = new_laptop(connects=False)
    bridge.do(f"offer('/tf'); send('/tf', '{MANY}', 60_000, 1000)")
    for _ in range(10):
        laptop.do(f"close_while_messages_arrive('ws://127.0.0.1:{port}', {closer!r}, {SECONDS})")
    laptop.until("[one for one in threading.enumerate() if 'ws' in one.name] == []")
