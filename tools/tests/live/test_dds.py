# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A robot over DDS: rclpy in one process, and in another one a program without ROS 2."""

import os
import re
import struct

import installing
import pytest
from obeying_processes import Obeying, OrderError
from paths import ROOT
from processes import run
from ros_domains import claim_domain
from shared_feed_tests import FORKING_PYTHON, RobotFeed, matched, why
from waiting import until

from tf2_ros.serialization import serialize_arrays
from tf2_ros_tools.live.address import parse

dds = pytest.importorskip("tf2_ros_tools.live.dds", reason="cyclonedds is not installed")

SECONDS = 60.0  # more than anything here takes


@pytest.fixture
def new_robot(processes):
    def make(**how):
        one = Obeying("robot_with_rclpy", **how)
        processes.append(one)
        one.do("from robot_with_rclpy import *; start()")
        return one

    return make


@pytest.fixture
def robot(new_robot):
    return new_robot()


@pytest.fixture
def new_laptop(processes):
    """Start a process without rclpy, whose `robot` is a feed."""

    def make(options="", where="dds://", connects=True, **environment):
        modules = "without_rclpy", "run_by_laptop", "tf2_ros_tools.live.dds"
        one = Obeying(*modules, environment=os.environ | environment if environment else None)
        processes.append(one)
        one.do("from run_by_laptop import *; import logging; logging.basicConfig()")
        if connects:
            one.do(f"robot = connect({where!r}, {options})")
        return one

    return make


@pytest.fixture
def laptop(new_laptop):
    return new_laptop()


class TestRobot(RobotFeed):
    none_lost = None  # over DDS, losses are not counted
    publishes, latches = "reliable, volatile", "reliable, transient local"


def test_names_of_nodes_of_a_robot_that_has_ended_are_forgotten(new_robot, laptop):
    first, second = new_robot(), new_robot()
    for one, name in ((first, "a"), (second, "b")):
        one.do(f"latched('{name}', ('base', '{name}', 1))")
    laptop.until("sorted(one.node for one in robot.publishers()) == ['/a', '/b']")
    first.end()
    laptop.until("[one.node for one in robot.publishers()] == ['/b']")
    laptop.until("not any('/a' in nodes.values() for nodes in robot._wire._nodes.values())")


def test_malformed_messages_are_counted_and_others_arrive(robot, laptop):
    matched(robot, laptop)
    good = serialize_arrays([("map", "base")], [5], [[1, 0, 0, 0, 0, 0, 1]])
    dropped_by_dds = good[:-4], b"\0\7" + good[2:], b"\0\1\0\0\xff\xff\xff\xff", b"", b"\0"
    dropped_by_us = good + bytes(8), good.replace(b"base", b"b\xff\xfee")
    for data in (*dropped_by_dds, *dropped_by_us, good):
        robot.do(f"send_bytes(out, {data.hex()!r})")
    laptop.until("robot.topics['/tf'].count")
    assert laptop.do("(robot.topics['/tf'].count, robot.topics['/tf'].malformed)") == [1, 2]
    assert laptop.do("seen(robot, 'map', 'base')") == 1
    until(lambda: "Ignoring a malformed message on /tf from /out: malformed TFMessage: " in laptop.errors())
    assert laptop.errors().count("Ignoring a malformed message") == 1


def test_a_callback_closes_the_feed_in_its_thread(robot, laptop):
    matched(robot, laptop)
    laptop.do(
        "called = []\n"
        "def close(transform):\n"
        "    called.append(transform.transform.translation.x)\n"
        "    robot.close('the goal is reached')\n"
        "watch = robot.buffer.on_change('map', 'f49', close)"
    )
    robot.do("sending = flood(out, 1000, 50, 500)")
    laptop.until("called")
    with pytest.raises(OrderError, match="dds:// has ended .the goal is reached."):
        laptop.do("robot.wait_until_heard(0)")
    laptop.until("[one for one in threading.enumerate() if one.name == 'dds://'] == []")
    assert len(laptop.do("called")) == 1
    laptop.do("robot.close()")
    assert laptop.errors() == ""


def test_closing_while_messages_arrive_and_connecting_again(robot, laptop):
    matched(robot, laptop)
    robot.do("sending = flood(out, 2000, 50, 20_000)")
    laptop.do("robot.close()")
    for _ in range(5):
        laptop.do("robot = connect('dds://')")
        laptop.until("robot.topics['/tf'].count > 2")
        laptop.do("robot.close(); after = robot.topics['/tf'].count")
        # The robot goes on sending.
        laptop.until("robot.topics['/tf'].last > 0.05")
        assert laptop.do("robot.topics['/tf'].count == after")
    # Nothing of them is left.
    assert laptop.do("import threading\nassert threading.active_count() == 1, threading.enumerate()") is None
    assert laptop.errors() == ""


def test_several_feeds_in_one_process(robot, new_laptop):
    robot.do("latched('mounts', ('base', 'camera', 1))")
    laptop = new_laptop()
    laptop.do("other = connect('dds://', prefix='other/', buffer=robot.buffer)")
    laptop.until("robot.buffer.can_transform('other/base', 'other/camera', 0)")
    laptop.until("robot.buffer.can_transform('base', 'camera', 0)")
    laptop.do("other.close(); robot.close()")


@pytest.mark.parametrize("end", ["", "robot.close()", "raise SystemExit(0)", "import os; os.fork()"])
def test_a_program_that_does_not_close_its_feed_ends(robot, end):
    robot.do("latched('mounts', ('base', 'camera', 1))")
    code = (
        "from tf2_ros_tools.live import connect\nrobot = connect('dds://')\n"
        f"robot.buffer.lookup_transform('base', 'camera', 0, timeout={SECONDS})\n"
        f"sender = robot.static_broadcaster()\n{end}"
    )
    ended = run(*FORKING_PYTHON, code, timeout=SECONDS)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")


@pytest.fixture
def kilted(new_robot):
    """A robot with ROS 2 Kilted, whose Fast DDS describes types in another way."""
    found = sorted((ROOT / "build" / "wheels").glob("overlays-*-kilted/bin/python"))
    if not found:
        pytest.skip(
            "ROS 2 Kilted is not there: `python -m release.rclpy_release_tests --only kilted` installs it"
        )
    environment = installing.unsourced() | {"PYTHONPATH": ""}
    # The wheels of ROS set these once, for their own libraries.
    for name in ("_ROS_WHEELS_BOOTSTRAP_COMPLETE", "LD_LIBRARY_PATH"):
        environment.pop(name, None)
    # The name that Fast DDS 3 reads.
    environment["FASTDDS_DEFAULT_PROFILES_FILE"] = environment.pop("FASTRTPS_DEFAULT_PROFILES_FILE")
    return new_robot(python=found[-1], environment=environment)


def test_a_robot_with_kilted(kilted, laptop):
    assert kilted.do("__import__('importlib.metadata').metadata.version('rclpy')").startswith("9.")
    kilted.do("latched('mounts', ('base', 'camera', 1))")
    matched(kilted, laptop)
    kilted.do("sending = flood(out, 200, 50, 400)")
    laptop.do(f"robot.wait_until_heard({SECONDS})")
    laptop.until("robot.topics['/tf'].count >= 400")
    assert laptop.do("heard(robot)") == [[400, None, 0], [1, None, 0]]
    assert laptop.do("(seen(robot, 'map', 'f49'), seen(robot, 'base', 'camera'))") == [399, 1]
    kilted.do("listen()")
    laptop.do("fixed = robot.static_broadcaster(); fixed.sendTransform(made('base', 'lidar', 2))")
    kilted.until("heard.get(('/tf_static', 'lidar')) == 2")


# On a busy machine, the time that discovery usually takes may be over before a text says so.
DISCOVERY = f"from tf2_ros_tools.live import dds; dds.DISCOVERY_S = {SECONDS}"


def test_nobody_is_there(new_laptop):
    domain = claim_domain()
    laptop = new_laptop(f"domain={domain}")
    laptop.do(DISCOVERY)
    with pytest.raises(OrderError) as raised:
        laptop.do("robot.wait_until_heard(0.5)")
    assert str(raised.value) == (
        "TimeoutError: nothing has been received on /tf or /tf_static in 0.5 s: no robot was found in "
        f"domain {domain} so far, and discovery takes up to 60 s. Check that its nodes run, and check "
        f"ROS_DOMAIN_ID, the robot's ROS_AUTOMATIC_DISCOVERY_RANGE, and the firewall (UDP from port "
        f"{7400 + 250 * domain}). Without multicast, give the robot's address: dds://?peers=192.168.0.7"
    )


def test_a_robot_in_another_domain_is_not_found(robot, new_laptop):
    robot.do("latched('mounts', ('base', 'camera', 1))")
    domain = claim_domain()
    laptop = new_laptop(ROS_DOMAIN_ID=str(domain))
    laptop.do("from tf2_ros_tools.live import dds; dds.DISCOVERY_S = 0")  # as if it had listened for long
    with pytest.raises(OrderError, match=f"no robot was found in domain {domain}. Check that its nodes run"):
        laptop.do("robot.wait_until_heard(0.5)")


def test_nobody_publishes_static_transforms(robot, laptop):
    laptop.do(DISCOVERY)
    matched(robot, laptop)
    robot.do("send(out, ('map', 'base'), ('map', 'b'))")
    laptop.until("robot.topics['/tf'].count")
    assert why(laptop) == (
        "TimeoutError: /tf is received (1 message), but nothing on /tf_static in 0.5 s: no node publishes "
        f"/tf_static in domain {os.environ['ROS_DOMAIN_ID']} so far, and discovery takes up to 60 s"
    )


@pytest.mark.parametrize(
    ("options", "sends", "discovery_s", "reason"),
    [
        (
            "'/tf_static'",
            True,
            5,
            "/fixed publishes it volatile, so it is not latched, and listeners require transient local",
        ),
        (
            "'/tf_static', reliable=False",
            True,
            5,
            "/fixed publishes it best-effort, and listeners require reliable",
        ),
        ("'/tf_static', latches=True", False, 0, "/fixed publishes it, but has sent nothing"),
        (
            "'/tf_static', latches=True",
            False,
            SECONDS,
            "/fixed publishes it, but has sent nothing so far, and discovery takes up to 60 s",
        ),
    ],
)
def test_publishers_from_which_nothing_arrives(robot, laptop, options, sends, discovery_s, reason):
    laptop.do(f"from tf2_ros_tools.live import dds; dds.DISCOVERY_S = {discovery_s}")
    matched(robot, laptop)
    robot.do(f"fixed = publisher('fixed', {options})")
    robot.do("send(out, ('map', 'base'))")
    if sends:
        robot.do("send(fixed, ('base', 'camera'))")
    laptop.until("len([one.node for one in robot.publishers() if one.node]) == 2")
    laptop.until("robot.topics['/tf'].count")
    text = f"TimeoutError: /tf is received (1 message), but nothing on /tf_static in 0.5 s: {reason}"
    assert why(laptop) == text


def test_simulated_time_is_refused(robot, laptop):
    laptop.begin(f"robot.buffer.lookup_transform('map', 'base', 0, timeout={SECONDS})")
    robot.do("clock()")
    why = r"dds:// has ended \(/clock is published, and simulated time is not supported\)"
    with pytest.raises(OrderError, match=f": {why}, which ended the wait for the transform after"):
        laptop.finish()
    with pytest.raises(OrderError, match=f"^ConnectionError: {why}$"):
        laptop.do(f"robot.wait_until_heard({SECONDS})")


def test_awaiting_with_asyncio(robot, laptop):
    matched(robot, laptop)
    laptop.begin(
        "import asyncio\n"
        "async def follow():\n"
        "    pose = await robot.buffer.lookup_transform_async('map', 'base', 0)\n"
        "    seen_x.append(pose.transform.translation.x)\n"
        "    async for pose in robot.buffer.changes('map', 'base'):\n"
        "        seen_x.append(pose.transform.translation.x)\n"
        "        if seen_x[-1] == 3: return\n"
        "seen_x = []\n"
        f"asyncio.run(asyncio.wait_for(follow(), {SECONDS}))"
    )
    robot.do("send(out, ('map', 'base', 1))")
    robot.do("send(out, ('map', 'base', 2))")
    robot.do("send(out, ('map', 'base', 3))")
    laptop.finish()
    assert laptop.do("(seen_x[0] >= 1, seen_x[-1])") == [True, 3]


# Multicast would leave this machine. Cyclone DDS must not add this machine to the peers by itself.
WITHOUT_MULTICAST = (
    "<CycloneDDS><Domain><General><AllowMulticast>false</AllowMulticast></General>"
    "<Discovery><Peers AddLocalhost='false'/></Discovery></Domain></CycloneDDS>"
)


@pytest.mark.parametrize(
    ("where", "peers"),
    [("dds://?peers=localhost", ""), ("dds://?peers=127.0.0.2,%20127.0.0.1", ""), ("dds://", "127.0.0.1")],
)
def test_a_robot_is_named_where_there_is_no_multicast(robot, new_laptop, where, peers):
    robot.do("latched('mounts', ('base', 'camera', 1))")
    laptop = new_laptop(
        where=where,
        ROS_AUTOMATIC_DISCOVERY_RANGE="SUBNET",
        ROS_STATIC_PEERS=peers,
        CYCLONEDDS_URI=WITHOUT_MULTICAST,
    )
    laptop.until("robot.topics['/tf_static'].count")


@pytest.mark.parametrize(
    ("where", "environment", "text"),
    [
        (
            "dds://",
            {"CYCLONEDDS_URI": "<X/>"},
            "Cyclone DDS cannot start (see its output above; CYCLONEDDS_URI is set): ",
        ),
        ("dds://?peers=127.0.0.1:7400", {}, "the peer '127.0.0.1:7400' has no IPv4 address"),
        (
            "dds://",
            {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"},
            "ROS_AUTOMATIC_DISCOVERY_RANGE is OFF, so nothing can be found",
        ),
    ],
)
def test_a_configuration_that_does_not_work(new_laptop, where, environment, text):
    laptop = new_laptop(connects=False, **environment)
    with pytest.raises(OrderError) as raised:
        laptop.do(f"connect({where!r})")
    assert str(raised.value).startswith(f"ConnectionError: {where}: {text}")


@pytest.mark.parametrize(
    "environment",
    [
        {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
        {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFFF"},
        {"ROS_LOCALHOST_ONLY": "1"},
        # It is the only one that rcl then obeys.
        {"ROS_LOCALHOST_ONLY": "1", "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"},
        {"ROS_LOCALHOST_ONLY": "1", "ROS_STATIC_PEERS": "127.0.0.2"},
    ],
    ids=str,
)
def test_a_robot_on_this_machine_only(monkeypatch, environment):
    for name in ("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS"):
        monkeypatch.delenv(name, raising=False)
    address = parse("dds://", 0, ("/tf", "/tf_static"))
    assert "AllowMulticast" not in dds._configuration(address)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    configuration = dds._configuration(address)
    assert "<AllowMulticast>false</AllowMulticast>" in configuration
    assert re.findall('Peer Address="(.*?)"', configuration) == ["127.0.0.1"]


def nodes_message(nodes, gid_bytes, order):
    """A message about nodes: namespace, name, number of subscriptions, and GUIDs of publishers."""
    data = bytearray([0, order == "<", 0, 0]) + bytes(gid_bytes)

    def number(value):
        data.extend(bytes(-len(data) % 4) + struct.pack(f"{order}I", value))

    number(len(nodes))
    for namespace, name, subscriptions, publishers in nodes:
        for text in (namespace, name):
            number(len(text) + 1)
            data.extend(text.encode() + b"\0")
        number(subscriptions)
        data.extend(bytes(subscriptions * gid_bytes))
        number(len(publishers))
        for guid in publishers:
            data.extend(guid.ljust(gid_bytes, b"\0"))
    return bytes(data)


GUIDS = [bytes([n]) * 16 for n in range(1, 4)]
NODES = [("/", "one", 2, GUIDS[:2]), ("/robot", "two", 0, GUIDS[2:]), ("/", "three", 1, [])]


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("gid_bytes", [16, 24])  # the second is Humble's
def test_names_of_nodes(gid_bytes, order):
    data = nodes_message(NODES, gid_bytes, order)
    assert dds.nodes_of_publishers(data) == dict(zip(GUIDS, ("/one", "/one", "/robot/two"), strict=True))
    for at in range(len(data)):
        assert dds.nodes_of_publishers(data[:at]) == {}
        for value in (0, 1, 127, 255):
            dds.nodes_of_publishers(data[:at] + bytes([value]) + data[at + 1 :])  # ends, without an error
