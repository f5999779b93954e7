# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
A robot with rmw_zenoh: in one process eclipse-zenoh, which speaks as rmw_zenoh does, and in another one a
program without ROS 2.

With `--long`, robots with rmw_zenoh_cpp are tested, too, if the variable TF2_TEST_RMW_ZENOH is the path of a
Python whose rclpy uses it. `make test-long` sets the variable.
"""

import os
import signal
import socket

import pytest
from obeying_processes import Obeying, OrderError
from processes import run
from shared_feed_tests import FORKING_PYTHON, RobotFeed, matched, why
from waiting import DEADLINE_S, until

pytest.importorskip("zenoh")

from tf2_ros_tools.live.zenoh import ATTACHMENT, _gid, _publisher_of

DOMAIN = os.environ["ROS_DOMAIN_ID"]
HASH = "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"
SECONDS = DEADLINE_S  # more than anything here takes
REAL = "TF2_TEST_RMW_ZENOH"
needs_rmw_zenoh = pytest.mark.long("needs rmw_zenoh_cpp")


@pytest.fixture
def new_obeying(processes):
    def make(*arguments, before="", **options):
        processes.append(Obeying(*arguments, **options))
        processes[-1].do(before)
        return processes[-1]

    return make


@pytest.fixture
def new_router(new_obeying, port):
    return lambda: new_obeying("robot_with_zenoh", before=f"import robot_with_zenoh as it; it.route({port})")


@pytest.fixture
def router(new_router):
    return new_router()


@pytest.fixture
def new_stand_in(new_obeying, router, port):
    """Start a robot of eclipse-zenoh, which can do what a robot of rmw_zenoh never does."""
    before = "from robot_with_rclpy import *; from robot_with_zenoh import *; import robot_with_zenoh"
    return lambda: new_obeying("robot_with_zenoh", before=f"{before}; start({port})")


@pytest.fixture
def stand_in(new_stand_in):
    return new_stand_in()


@pytest.fixture
def new_real(new_obeying, router, port):
    """Start a robot of rmw_zenoh_cpp."""
    if REAL not in os.environ:
        pytest.skip(f"{REAL} is not the path of a Python with rmw_zenoh_cpp")
    session = f'transport/shared_memory/enabled=false;connect/endpoints=["tcp/127.0.0.1:{port}"]'
    set_up = f"import os; os.environ['ZENOH_CONFIG_OVERRIDE'] = {session!r}"
    before = f"{set_up}; from robot_with_rclpy import *; start()"
    return lambda: new_obeying(python=os.environ[REAL], before=before)


@pytest.fixture(params=["new_stand_in", pytest.param("new_real", marks=needs_rmw_zenoh)])
def new_robot(request):
    return request.getfixturevalue(request.param)


@pytest.fixture
def robot(new_robot):
    return new_robot()


@pytest.fixture
def new_laptop(new_obeying, port):
    """Start a process without rclpy, whose `robot` is a feed."""

    def make(options="", connects=True):
        modules = "without_rclpy", "run_by_laptop", "tf2_ros_tools.live.zenoh"
        laptop = new_obeying(*modules, before="from run_by_laptop import *")
        if connects:
            laptop.do(f"robot = connect('zenoh://127.0.0.1:{port}', {options})")
        return laptop

    return make


@pytest.fixture
def laptop(new_laptop, router):
    return new_laptop()


# A robot, of either kind.


class TestRobot(RobotFeed):
    none_lost = 0
    publishes = latches = HASH


@pytest.mark.long("sends for half a minute")
def test_what_a_robot_drops_for_a_stopped_laptop_is_counted(robot, laptop):
    matched(robot, laptop)
    robot.do("sending = flood(out, 2000, 50, 20_000)")
    laptop.until("robot.topics['/tf'].count > 0")
    laptop.process.send_signal(signal.SIGSTOP)
    robot.do("import time; time.sleep(5)")
    laptop.process.send_signal(signal.SIGCONT)
    robot.do(f"sending.join(4 * {SECONDS})")
    sent, found = 20_000, []

    def are_counted():
        """The last ones may be lost, too, which only later ones reveal."""
        nonlocal sent, found
        robot.do("flood(out, 100, 50, 10).join()")
        sent += 10
        found = laptop.do("heard(robot)[0]")
        return sum(found) >= sent

    until(are_counted)
    count, lost, malformed = found
    assert lost > 0
    assert (count + lost, malformed) == (sent, 0)


def test_the_publishers_of_a_robot_that_is_killed_are_forgotten(robot, laptop):
    robot.do("latched('mounts', ('base', 'camera', 1))")
    laptop.until("robot.publishers()")
    robot.kill()
    laptop.until("robot.publishers() == []")


def test_a_router_that_is_killed_and_started_again(robot, router, new_router, new_laptop):
    robot.do("latched('mounts', ('base', 'camera', 1))")
    laptop = new_laptop()
    matched(robot, laptop)
    robot.do("send(out, ('map', 'base', 1))")
    laptop.until("robot.topics['/tf'].count == 1")
    laptop.until("robot.topics['/tf_static'].count == 1")
    router.kill()
    laptop.until("robot.publishers() == []")
    assert "no longer answers" in laptop.do("robot._wire.why_silent('/tf', 1.0)")
    robot.do("send(out, ('map', 'lost', 2))")
    new_router()
    sent = 2
    while laptop.do("robot.topics['/tf'].count") == 1:
        robot.do("send(out, ('map', 'base', 3)); time.sleep(0.1)")
        sent += 1
    laptop.until(f"sum(heard(robot)[0]) == {sent}")
    assert laptop.do("seen(robot, 'map', 'base')") == 3
    (_, lost, malformed), fixed = laptop.do("heard(robot)")
    assert lost >= 1 and malformed == 0
    # What is latched may arrive once more, and is not counted again.
    assert fixed == [1, 0, 0]


def test_two_laptops_hear_each_other(router, new_laptop):
    first, second = new_laptop(), new_laptop()
    first.do("robot.static_broadcaster().sendTransform(made('base', 'camera', 1))")
    second.until("robot.buffer.can_transform('base', 'camera', 0)")
    second.until("robot.publishers()")  # what is known of one may arrive after what it sends
    [[topic, node, type_hash]] = second.do("[one[:3] for one in robot.publishers()]")
    assert (topic, node[:10], type_hash) == ("/tf_static", "/tf2_live_", HASH)


@needs_rmw_zenoh
def test_a_laptop_is_a_node_of_the_graph(new_real, laptop):
    robot = new_real()
    laptop.do("fixed = robot.static_broadcaster()")
    robot.do("asking = node('asking')")
    robot.until("asking.count_publishers('/tf_static') == 1")
    robot.do("[found] = asking.get_publishers_info_by_topic('/tf_static')")
    assert robot.do("str(found.topic_type_hash)") == HASH
    assert robot.do("(found.topic_type, found.qos_profile.durability.name, found.qos_profile.depth)") == [
        "tf2_msgs/msg/TFMessage",
        "TRANSIENT_LOCAL",
        1,
    ]
    assert robot.do("found.node_name") in robot.do("asking.get_node_names()")
    assert robot.do("[asking.count_subscribers(topic) for topic in ('/tf', '/tf_static')]") == [1, 1]
    laptop.do("robot.close()")
    robot.until("asking.count_publishers('/tf_static') == 0")
    robot.until("found.node_name not in asking.get_node_names()")


# Why nothing arrives.


NOTHING = "TimeoutError: nothing has been received on /tf or /tf_static in 0.5 s: "
NO_STATIC = "TimeoutError: /tf is received (1 message), but nothing on /tf_static in 0.5 s: "


def test_nothing_answers(new_laptop, port):
    laptop = new_laptop(connects=False)
    with pytest.raises(OrderError) as raised:
        laptop.do(f"connect('zenoh://127.0.0.1:{port}')")
    assert str(raised.value) == (
        f"ConnectionError: connect: nothing answers at tcp/127.0.0.1:{port}. Start a router on the "
        "robot with ros2 run rmw_zenoh_cpp rmw_zenohd, or check the address"
    )


def test_something_else_answers(new_laptop, port):
    laptop = new_laptop(connects=False)
    with socket.create_server(("127.0.0.1", port)), pytest.raises(OrderError) as raised:
        laptop.do(f"connect('zenoh://127.0.0.1:{port}')")
    assert f"nothing answers at tcp/127.0.0.1:{port}. Start" in str(raised.value)


def test_a_host_without_an_address(new_laptop):
    laptop = new_laptop(connects=False)
    with pytest.raises(
        OrderError, match="^ConnectionError: connect: the host robot.invalid has no address: "
    ):
        laptop.do("connect('zenoh://robot.invalid')")


def test_a_router_without_nodes(laptop, port):
    assert why(laptop) == (
        f"{NOTHING}tcp/127.0.0.1:{port} is reached, but no node publishes /tf there: is the robot's RMW "
        "rmw_zenoh_cpp?"
    )


@pytest.mark.parametrize(("latches", "topics"), [(False, "/tf is"), (True, "/tf and /tf_static are")])
def test_another_domain(robot, new_laptop, latches, topics):
    robot.do("out = publisher('out')")
    if latches:
        robot.do("latched('mounts', ('base', 'camera', 1))")
    other = (int(DOMAIN) + 1) % 102
    laptop = new_laptop(f"domain={other}")
    text = f"{NOTHING}{topics} published in domain {DOMAIN}, and this feed is in domain {other}"
    assert why(laptop) == text


def test_nobody_publishes_static_transforms(robot, laptop):
    matched(robot, laptop)
    robot.do("send(out, ('map', 'base', 1))")
    laptop.until("robot.topics['/tf'].count")
    assert why(laptop) == f"{NO_STATIC}no node publishes /tf_static in domain {DOMAIN}"


@pytest.mark.parametrize(
    ("latches", "reason"),
    [
        (False, "/fixed publishes it volatile, so it is not latched"),
        (True, "/fixed publishes it, but has sent nothing"),
    ],
)
def test_a_publisher_from_which_nothing_arrives(robot, laptop, latches, reason):
    matched(robot, laptop)
    robot.do(f"fixed = publisher('fixed', '/tf_static', latches={latches})")
    robot.do("send(out, ('map', 'base', 1))")
    laptop.until("robot.topics['/tf'].count and len(robot.publishers()) == 2")
    assert why(laptop) == NO_STATIC + reason


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (
            "type_hash='RIHS01_0'",
            f"/fixed publishes it with type hash RIHS01_0, and this feed reads {HASH}",
        ),
        ("type_name='tf2_msgs::msg::dds_::Old_'", "/fixed publishes it as tf2_msgs::msg::dds_::Old_"),
    ],
)
def test_another_definition(stand_in, laptop, options, reason):
    matched(stand_in, laptop)
    stand_in.do(f"latched('fixed', ('base', 'camera', 1), {options})")
    stand_in.do("send(out, ('map', 'base', 1))")
    laptop.until("robot.topics['/tf'].count and len(robot.publishers()) == 2")
    assert why(laptop) == NO_STATIC + reason
    assert laptop.do("heard(robot)") == [[1, 0, 0], [0, 0, 0]]


def test_simulated_time_is_refused(robot, new_laptop, port):
    laptop = new_laptop()
    robot.do("clock()")
    text = "/clock is published, and simulated time is not supported"
    for one in (laptop, new_laptop()):
        with pytest.raises(OrderError, match=f"^ConnectionError: zenoh://127.0.0.1:{port} has ended.*{text}"):
            one.do(f"robot.wait_until_heard({SECONDS})")


# What a stand-in does, and no robot, or none in a hurry.


def test_losses_are_counted_for_each_publisher_and_repeated_messages_left_out(stand_in, laptop):
    matched(stand_in, laptop)
    stand_in.do("data = robot_with_zenoh.serialize_message(TFMessage()); other = publisher('other')")
    for sequence, sent_ns in ((7, 70), (9, 90), (9, 90), (8, 80), (10, 100), (14, 140)):
        stand_in.do(f"out.put(data, {sequence}, {sent_ns}); other.put(data, {sequence}, {sent_ns})")
    laptop.until("robot.topics['/tf'].count >= 8")
    assert laptop.do("heard(robot)[0]") == [8, 8, 0]


def test_a_damaged_sequence_number_is_neither_a_loss_nor_an_end(stand_in, laptop):
    matched(stand_in, laptop)
    stand_in.do("data = robot_with_zenoh.serialize_message(TFMessage())")
    for sequence, sent_ns in ((1, 1), (2**63 - 1, 2), (3, 3), (-(2**63), 4), (5, 5), (6, -(2**63))):
        stand_in.do(f"out.put(data, {sequence}, {sent_ns})")
    laptop.until("robot.topics['/tf'].count >= 6")
    assert laptop.do("heard(robot)[0]") == [6, 0, 0]


def test_what_is_kept_of_publishers_that_have_ended_is_bounded(stand_in, laptop):
    laptop.do("import tf2_ros_tools.live.zenoh; tf2_ros_tools.live.zenoh.ENDED_PUBLISHERS_KEPT = 3")
    matched(stand_in, laptop)
    stand_in.do("data = robot_with_zenoh.serialize_message(TFMessage())")
    for n in range(10):
        stand_in.do(f"one = publisher('n{n}'); one.put(data, 1, {n + 1})")
        laptop.until(f"robot.topics['/tf'].count == {n + 1} and len(robot.publishers()) == 2")
        stand_in.do("one._tokens.clear(); robot_with_zenoh._kept.remove(one); del one")
        laptop.until("len(robot.publishers()) == 1")
    assert laptop.do("len(robot._wire._nodes)") <= 5
    # The publisher that is left is still known by its name, and its losses are counted.
    stand_in.do("out.put(data, 1, 100); out.put(data, 3, 101)")
    laptop.until("robot.topics['/tf'].count == 12")
    assert laptop.do("robot.topics['/tf'].lost") == 1
    assert laptop.do("[one.node for one in robot.publishers()]") == ["/out"]


def test_a_robot_of_humble_has_no_hashes(stand_in, laptop):
    stand_in.do("listen('TypeHashNotSupported')")
    stand_in.do("latched('fixed', ('base', 'camera', 1), type_hash='TypeHashNotSupported')")
    laptop.until("robot.buffer.can_transform('base', 'camera', 0)")
    assert laptop.do("[one[:3] for one in robot.publishers()]") == [
        ["/tf_static", "/fixed", "TypeHashNotSupported"]
    ]
    laptop.do("robot.static_broadcaster().sendTransform(made('base', 'lidar', 2))")
    stand_in.until("('/tf_static', 'lidar') in heard")


def test_damaged_messages_and_attachments(stand_in, laptop):
    """A good message arrives after each damaged one, and what is intact in these is used."""
    matched(stand_in, laptop)
    stand_in.do(
        """
from hypothesis import HealthCheck, given, settings, strategies as st
good = robot_with_zenoh.serialize_message(TFMessage(transforms=[made('map', 'base')]))
attached = robot_with_zenoh.struct.pack('<qqB', 1, 1, 16) + out.gid

def damaged(whole):
    at = st.integers(0, len(whole))
    cuts = st.tuples(at, at, st.binary(max_size=40))
    changed = cuts.map(lambda cut: whole[: cut[0]] + cut[2] + whole[cut[1] :])
    return st.one_of(st.binary(max_size=64), changed, st.just(whole))

sent = 0
@settings(max_examples=500, deadline=None, database=None)
@given(damaged(good), damaged(attached))
def send_damaged(data, attachment):
    global sent
    out.put_with(data, attachment)
    sent += 1
"""
    )
    stand_in.do("send_damaged()")
    assert stand_in.do("sent") >= 500
    stand_in.do("last = publisher('last'); send(last, ('map', 'last', 1))")
    laptop.until("robot.buffer.can_transform('map', 'last', 0)")
    count, _, malformed = laptop.do("heard(robot)[0]")
    assert count > 1 and malformed > 1
    stand_in.do(
        "out.put_with(good, b''); out.put_with(good, attached[:-1]); out.put_with(good, attached + b'1')"
    )
    laptop.until(f"robot.topics['/tf'].count == {count + 3}")
    laptop.do("robot.close()")
    assert "Traceback" not in laptop.errors()
    assert laptop.errors().count("Ignoring a malformed message on /tf") == 1


# The end.


@pytest.mark.parametrize("closer", ["a thread", "a callback", "several"])
def test_a_feed_closes_while_messages_arrive(stand_in, new_laptop, port, closer):
    laptop = new_laptop(connects=False)
    stand_in.do("out = publisher('out'); flood(out, 1000, 50, 60_000)")
    for _ in range(10):
        laptop.do(f"close_while_messages_arrive('zenoh://127.0.0.1:{port}', {closer!r}, {SECONDS})")
    laptop.until("[one for one in threading.enumerate() if 'zenoh' in one.name] == []")


def test_broadcasters_end_with_their_feed(laptop, port):
    laptop.do("moving, fixed = robot.broadcaster(), robot.static_broadcaster()")
    laptop.do("robot.close()")
    for broadcaster in ("moving", "fixed"):
        with pytest.raises(OrderError, match=f"^ConnectionError: zenoh://127.0.0.1:{port} has ended"):
            laptop.do(f"{broadcaster}.sendTransform(made('base', 'camera', 1))")


FORGETS = """
import os, sys
sys.modules["rclpy"] = None
from tf2_ros_tools.live import connect
robot = connect("zenoh://127.0.0.1:{port}")
robot.wait_until_heard({seconds})
if {forks}:
    child = os.fork()
    if child:
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
        count = robot.topics["/tf"].count
        while robot.topics["/tf"].count <= count + 10:
            pass
    else:
        robot.close()
        os._exit(0)  # zenoh's exit handlers may wait in a child for a lock of the parent's threads
"""


@pytest.mark.parametrize("forks", [False, True])
def test_a_program_ends_that_does_not_close_its_feed(stand_in, port, forks):
    stand_in.do(
        "latched('fixed', ('base', 'camera', 1)); out = publisher('out'); flood(out, 200, 50, 60_000)"
    )
    ended = run(*FORKING_PYTHON, FORGETS.format(port=port, seconds=SECONDS, forks=forks))
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")


FORKS_AND_CONNECTS = """
import os, sys
sys.modules["rclpy"] = None
from tf2_ros_tools.live import connect
where = "zenoh://127.0.0.1:{port}"
if os.fork() == 0:
    connect(where).close()  # before the parent
    os._exit(0)
assert os.wait()[1] == 0
try:
    connect("zenoh://127.0.0.1:1")
except ConnectionError:
    pass  # nothing answers there
with connect(where):
    if os.fork() == 0:
        try:
            connect(where)
        except ConnectionError as error:
            assert str(error).startswith(where + ": Zenoh has been used by the parent process"), error
            os._exit(0)
        os._exit(1)
    assert os.wait()[1] == 0
connect(where).close()
"""


def test_a_forked_child_is_refused_a_feed_if_its_parent_has_used_zenoh(router, port):
    ended = run(*FORKING_PYTHON, FORKS_AND_CONNECTS.format(port=port))
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")


# The wire, as captured from rmw_zenoh_cpp 0.2.10 of Jazzy.

TOKEN = (
    "@ros2_lv/74/2cf6b29e5b3de1abd7fffad6da5b7da4/0/11/MP/%/%left%hand/arm/%tf_static/"
    f"tf2_msgs::msg::dds_::TFMessage_/{HASH}/:1:,1:,:,:,,"
)
ATTACHED = "01000000000000009f851644abfeeb1810d01d582bc03d94eccc21ae10df43613f"


def test_a_token_and_an_attachment_name_a_publisher():
    entity = _publisher_of(TOKEN)
    assert (entity.domain, entity.node) == ("74", "/left/hand/arm")
    assert (entity.topic, entity.type_hash) == ("/tf_static", HASH)
    sequence, sent_ns, size, gid = ATTACHMENT.unpack(bytes.fromhex(ATTACHED))
    assert (sequence, sent_ns, size) == (1, 1795808887972464031, 16)
    assert gid == _gid(TOKEN) == bytes.fromhex("d01d582bc03d94eccc21ae10df43613f")


@pytest.mark.parametrize(
    "token", ["", "@ros2_lv", "@ros2_lv/74/1/0/0/MP/%/%", "@ros2_lv/74/1/0/0/MP/%/%/n/%tf/T/H/Q/more"]
)
def test_tokens_of_others(token):
    assert _publisher_of(token) is None
