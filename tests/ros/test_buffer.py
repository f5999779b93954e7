# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The buffer of a node: waiting for transforms, its service, its clock."""

import gc
import re
import signal
import subprocess
import threading
import weakref

import pytest
from geometry_msgs.msg import PointStamped
from processes import start
from rclpy.clock import ClockChange
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from times_and_transforms import at, transform
from waiting import DEADLINE_S, PROMPT_S, errors_so_far, seconds_of, until

LONG = Duration(seconds=DEADLINE_S)
SHORT = Duration(seconds=0.05)
LATEST = Time()
ENDED = r"The context was shut down, which ended the wait for the transform after [\d.]+ s"


@pytest.fixture
def later():
    """Does something in another thread as soon as the condition holds."""
    threads = []

    def do(what, *arguments, when=lambda: True):
        def run():
            until(when)
            what(*arguments)

        threads.append(threading.Thread(target=run))
        threads[-1].start()

    yield do
    for thread in threads:
        thread.join(DEADLINE_S)
        assert not thread.is_alive()


def waits(buffer):
    """Whether somebody waits for the buffer."""
    return lambda: buffer.statistics()["waiters"] > 0


def insert(buffer, *seconds):
    for one in seconds:
        buffer.set_transform(transform("map", "robot", one, (one, 0, 0)), "me")


def point(seconds):
    message = PointStamped()
    message.header.frame_id, message.header.stamp = "robot", at(seconds).to_msg()
    return message


# Each needs the robot in the map at second 5, and has a timeout last.
CALLS = {
    "lookup_transform": lambda b, timeout: b.lookup_transform("map", "robot", at(5), timeout),
    "lookup_transform_full": lambda b, timeout: b.lookup_transform_full(
        "map", at(1), "robot", at(5), "map", timeout
    ),
    "transform": lambda b, timeout: b.transform(point(5), "map", timeout),
    "can_transform": lambda b, timeout: b.can_transform("map", "robot", at(5), timeout, True),
    "can_transform_full": lambda b, timeout: b.can_transform_full(
        "map", at(1), "robot", at(5), "map", timeout, True
    ),
}
every_call = pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)


def refusal(call, buffer, timeout):
    """Seconds, and the text of the error or the reason; None: it was answered."""
    found = []
    seconds, error = seconds_of(lambda: found.append(call(buffer, timeout)))
    if error is None and isinstance(found[0], tuple):
        can, reason = found[0]
        assert (can is True) == (reason == "")
        return seconds, reason or None
    return seconds, None if error is None else str(error)


class TestTimeout:
    @every_call
    @pytest.mark.parametrize("known", [[], [1]], ids=["unknown", "too old"])
    def test_the_error_is_that_of_the_lookup_and_says_last_how_long_was_waited(self, buffer, call, known):
        insert(buffer, *known)
        for none in (Duration(), Duration(seconds=-1)):
            _, without = refusal(call, buffer, none)
            assert re.search("does not exist|extrapolation", without) and "Waited" not in without
        seconds, text = refusal(call, buffer, SHORT)
        assert text == f"{without}. Waited 0.05 s"
        assert 0.05 <= seconds < PROMPT_S

    def test_a_timeout_of_microseconds_is_one(self, buffer, tf2_py):
        timeout = Duration(nanoseconds=200_000)

        def is_over_soon():
            seconds, error = seconds_of(lambda: buffer.lookup_transform("map", "robot", LATEST, timeout))
            assert seconds >= 0.0002 and type(error) is tf2_py.LookupException
            return seconds < 0.02

        # Polling, as tf2 does, takes 20 ms each time; on a busy machine, some waits do.
        until(is_over_soon)

    @pytest.mark.parametrize("name", ["", "/map"])
    def test_an_invalid_name_is_not_waited_for(self, ros, tf2_ros, node, name):
        buffer = tf2_ros.Buffer(node=node)
        ros.shutdown()
        with pytest.raises(tf2_ros.InvalidArgumentException, match=r"cannot (be empty|start with a '/')$"):
            buffer.lookup_transform(name, "robot", LATEST, LONG)
        assert not buffer.can_transform(name, "robot", LATEST, LONG)


class TestEndOfTheWait:
    @pytest.mark.parametrize("with_node", [False, True])
    def test_shutting_down_ends_it(self, ros, tf2_ros, node, later, with_node):
        buffer = tf2_ros.Buffer(node=node if with_node else None)
        later(ros.shutdown, when=waits(buffer))
        seconds, refused = refusal(CALLS["lookup_transform"], buffer, LONG)
        assert re.fullmatch(ENDED, refused) and seconds < PROMPT_S

    @pytest.mark.parametrize("link", ["node", "listener", "past one", "assigned one", "its own node"])
    def test_after_the_shutdown_of_what_fills_it_nothing_is_waited_for(self, ros, tf2_ros, node, link):
        buffer = tf2_ros.Buffer(node=node if link == "node" else None)
        if link != "node":
            first = tf2_ros.Buffer() if link == "assigned one" else buffer
            listener = tf2_ros.TransformListener(first, None if link == "its own node" else node)
            listener.buffer = buffer
            if link == "past one":
                listener.unregister()
                del listener
        insert(buffer, 1)
        ros.shutdown()
        for call in CALLS.values():
            seconds, refused = refusal(call, buffer, LONG)
            assert re.fullmatch(ENDED, refused) and seconds < PROMPT_S
        assert buffer.lookup_transform("map", "robot", at(1), LONG).child_frame_id == "robot"
        # What does not wait is not ended by it.
        assert "shut down" not in refusal(CALLS["lookup_transform"], buffer, Duration())[1]

    def test_what_a_program_fills_by_itself_is_waited_for_after_a_shutdown(self, ros, later, buffer):
        ros.shutdown()
        later(insert, buffer, 1, when=waits(buffer))
        assert buffer.can_transform("map", "robot", LATEST, LONG)
        assert refusal(CALLS["lookup_transform"], buffer, SHORT)[1].endswith("Waited 0.05 s")

    @pytest.mark.parametrize("with_node", [False, True])
    def test_a_listener_of_a_context_that_goes_on_is_waited_for(
        self, ros, new_node, tf2_ros, node, later, with_node
    ):
        context = ros.Context()
        context.init(args=[])
        buffer = tf2_ros.Buffer(node=node if with_node else None)
        listener = tf2_ros.TransformListener(buffer, new_node("elsewhere", context=context))
        ros.shutdown()
        later(insert, buffer, 1, when=waits(buffer))
        assert buffer.can_transform("map", "robot", LATEST, LONG)
        later(context.shutdown, when=waits(buffer))
        assert re.fullmatch(ENDED, refusal(CALLS["can_transform"], buffer, LONG)[1])
        listener.unregister()

    def test_ctrl_c_ends_it(self):
        program = start("waits_until_signal.py", stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        assert program.stdout.readline() == "waiting\n"
        program.send_signal(signal.SIGINT)
        _, errors = program.communicate(timeout=DEADLINE_S)
        assert errors.splitlines()[-1] == "KeyboardInterrupt"


@pytest.mark.parametrize("with_node", [False, True])
def test_a_dropped_buffer_is_freed_at_once(tf2_ros, node, with_node):
    buffer = tf2_ros.Buffer(node=node if with_node else None)
    if with_node:
        node.destroy_service(buffer.srv)
    reference = weakref.ref(buffer)
    del buffer
    gc.collect()
    assert reference() is None
    # The clock must have forgotten it, too: it would call into freed memory.
    node.set_parameters([Parameter("use_sim_time", value=True)])


def test_a_buffer_of_a_class_that_does_not_call_init_keeps_what_waits(tf2_ros):
    class Bare(tf2_ros.Buffer):
        def __init__(self):
            pass

    for make in (Bare, lambda: tf2_ros.Buffer.__new__(tf2_ros.Buffer)):
        buffer, called = make(), []
        future = buffer.wait_for_transform_async("map", "robot", Time(seconds=1))
        future.add_done_callback(lambda done, called=called: called.append(done.result().header.stamp.sec))
        del future
        buffer.on_change("map", "robot", lambda found, called=called: called.append("changed"))
        gc.collect()
        buffer.set_transform(transform("map", "robot", 1), "here")
        assert called == [1, "changed"]
        assert len(buffer._tf2_kept) == 1


class TestOpen:
    @pytest.fixture
    def path(self, tf2_ros, tmp_path):
        recorded = tf2_ros.Buffer()
        insert(recorded, 1)
        recorded.freeze(tmp_path / "drive.tf2")
        return tmp_path / "drive.tf2"

    def test_an_opened_buffer_has_the_clock_and_the_service_of_its_node(self, tf2_ros, node, path, capfd):
        opened = tf2_ros.Buffer.open(path, node=node)
        assert opened.can_transform("map", "robot", LATEST)
        assert opened.clock is node.get_clock() and opened.srv in node.services
        assert opened.srv.srv_name == "tf2_frames"
        node.set_parameters([Parameter("use_sim_time", value=True)])
        assert not opened.can_transform("map", "robot", LATEST)
        assert capfd.readouterr().err.count("Simulated time was switched on. Clearing") == 1
        node.destroy_service(opened.srv)
        reference = weakref.ref(opened)
        del opened
        gc.collect()
        assert reference() is None

    def test_nothing_is_left_of_what_cannot_be_opened(self, tf2_ros, node, path):
        before = [*node.services]
        with pytest.raises(TypeError, match="Buffer: expected a node with create_service, got str"):
            tf2_ros.Buffer.open(path, node="node")
        with pytest.raises(FileNotFoundError):
            tf2_ros.Buffer.open(path.with_name("gone.tf2"), node=node)
        assert [*node.services] == before


class TestTimeJump:
    @pytest.fixture
    def full(self, tf2_ros, node):
        buffer = tf2_ros.Buffer(node=node)
        insert(buffer, 1)
        buffer.set_transform_static(transform("robot", "camera"), "me")
        return buffer

    def test_switching_sim_time_on_and_off_clears_and_says_so(self, full, node, capfd):
        for is_on in (True, False):
            insert(full, 1)
            node.set_parameters([Parameter("use_sim_time", value=is_on)])
            assert not full.can_transform("map", "robot", LATEST)
            assert full.can_transform("robot", "camera", LATEST)
            switched = f"Simulated time was switched {'on' if is_on else 'off'}. Clearing TF buffer."
            assert switched in capfd.readouterr().err

    def test_a_jump_back_of_a_second_clears_and_says_so(self, full, node, capfd):
        node.set_parameters([Parameter("use_sim_time", value=True)])
        clock = node.get_clock()
        clock.set_ros_time_override(Time(seconds=100, clock_type=clock.clock_type))
        insert(full, 1)
        for seconds in (200, 199.5):
            clock.set_ros_time_override(Time(seconds=seconds, clock_type=clock.clock_type))
            assert full.can_transform("map", "robot", LATEST)
        capfd.readouterr()
        clock.set_ros_time_override(Time(seconds=198.5, clock_type=clock.clock_type))
        assert not full.can_transform("map", "robot", LATEST)
        assert "jump back in time. Clearing" in capfd.readouterr().err

    def test_two_publishers_of_the_clock_are_named_at_a_jump(self, tf2_ros, new_node, executor, capfd):
        listening = new_node("listening", parameter_overrides=[Parameter("use_sim_time", value=True)])
        executor.add_node(listening)
        buffer = tf2_ros.Buffer(node=listening)
        player = new_node("player", namespace="/bag").create_publisher(Clock, "/clock", 10)

        def jumps(publishers):
            capfd.readouterr()

            def seen():
                for seconds, publisher in zip((200, 100), publishers, strict=True):
                    publisher.publish(Clock(clock=Time(seconds=seconds).to_msg()))
                    executor.spin_once(timeout_sec=0.1)
                return "Clearing TF buffer." in errors_so_far()

            until(seen)
            return errors_so_far()

        # A recording that is played again and again has one.
        assert "publishers" not in jumps([player, player])
        other = new_node("simulator").create_publisher(Clock, "/clock", 10)
        until(lambda: len(listening.get_publishers_info_by_topic("/clock")) == 2)
        said = "/clock has 2 publishers, /bag/player and /simulator: the clock jumps between their times"
        assert said in jumps([player, other])
        assert not buffer.frames()

    def test_a_subclass_may_do_otherwise(self, tf2_ros, node):
        seen = []

        class Mine(tf2_ros.Buffer):
            def time_jump_callback(self, time_jump):
                seen.append(time_jump.clock_change)

        buffer = Mine(node=node)
        node.set_parameters([Parameter("use_sim_time", value=True)])
        assert seen == [ClockChange.ROS_TIME_ACTIVATED]
        assert buffer.jump_handle is not None
