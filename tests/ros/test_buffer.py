"""The buffer of a node: waiting for transforms, its service, its clock."""

import gc
import re
import signal
import subprocess
import threading
import weakref

import pytest
from geometry_msgs.msg import PointStamped
from making import at, stamp_ns, transform, translation
from processes import DEADLINE_S, PROMPT_S, seconds_of, start, until
from rclpy.clock import ClockChange, TimeJump
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from rclpy.time import Time

from tf2_msgs.srv import FrameGraph

LONG = Duration(seconds=DEADLINE_S)
SHORT = Duration(seconds=0.05)
LATEST = Time()


@pytest.fixture
def buffer(tf2_ros):
    return tf2_ros.Buffer()


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


ENDED = r"The context was shut down, which ended the wait for the transform after [\d.]+ s"


def point(frame, seconds=0.0):
    message = PointStamped()
    message.header.frame_id, message.header.stamp = frame, at(seconds).to_msg()
    return message


def waits(buffer):
    """Whether somebody waits for the buffer."""
    return lambda: buffer.statistics()["waiters"] > 0


class TestLookup:
    def test_it_answers_with_what_was_set(self, buffer):
        buffer.set_transform(transform("map", "robot", 1, (1, 2, 3)), "me")
        found = buffer.lookup_transform("map", "robot", at(1))
        assert (found.header.frame_id, found.child_frame_id, stamp_ns(found)) == ("map", "robot", 10**9)
        assert translation(found) == (1.0, 2.0, 3.0)

    def test_names_and_time_may_be_keywords(self, buffer):
        buffer.set_transform_static(transform("map", "robot", 0, (1, 0, 0)), "me")
        found = buffer.lookup_transform(
            target_frame="map", source_frame="robot", time=LATEST, timeout=Duration()
        )
        assert translation(found) == (1.0, 0.0, 0.0)

    def test_a_time_may_be_a_message(self, buffer):
        buffer.set_transform(transform("map", "robot", 1), "me")
        assert stamp_ns(buffer.lookup_transform("map", "robot", at(1).to_msg())) == 10**9

    def test_full_goes_through_the_fixed_frame(self, buffer):
        for seconds in (1, 2):
            buffer.set_transform(transform("map", "robot", seconds, (seconds, 0, 0)), "me")
        found = buffer.lookup_transform_full("robot", at(2), "robot", at(1), "map")
        assert translation(found) == (-1.0, 0.0, 0.0)
        assert stamp_ns(found) == 2 * 10**9

    def test_an_available_transform_is_not_waited_for(self, buffer):
        buffer.set_transform_static(transform("map", "robot"), "me")
        seconds, error = seconds_of(lambda: buffer.lookup_transform("map", "robot", LATEST, LONG))
        assert error is None
        assert seconds < PROMPT_S

    @pytest.mark.ours
    def test_it_wakes_when_the_transform_is_inserted(self, buffer, later):
        later(buffer.set_transform, transform("map", "robot", 1), "me", when=waits(buffer))
        assert buffer.lookup_transform("map", "robot", at(1), LONG).child_frame_id == "robot"

    @pytest.mark.ours
    def test_full_wakes_when_the_transform_is_inserted(self, buffer, later):
        later(buffer.set_transform_static, transform("map", "robot"), "me", when=waits(buffer))
        found = buffer.lookup_transform_full("map", at(2), "robot", at(1), "map", timeout=LONG)
        assert found.child_frame_id == "robot"

    @pytest.mark.ours
    def test_other_transforms_do_not_wake_it(self, buffer, later):
        def insert():
            for seconds in range(1, 20):
                buffer.set_transform(transform("map", "other", seconds), "me")
                buffer.set_transform(transform("map", "robot", seconds), "me")

        later(insert, when=waits(buffer))
        found = buffer.lookup_transform("map", "robot", at(18.5), LONG)
        assert stamp_ns(found) == 18_500_000_000

    def test_after_the_timeout_it_raises_what_the_lookup_raises(self, buffer, tf2_py):
        buffer.set_transform(transform("map", "robot", 1), "me")
        seconds, error = seconds_of(lambda: buffer.lookup_transform("map", "robot", at(5), SHORT))
        assert type(error) is tf2_py.ExtrapolationException
        assert 0.05 <= seconds < PROMPT_S

    @pytest.mark.ours
    def test_the_error_says_last_how_long_was_waited(self, buffer, tf2_py):
        with pytest.raises(tf2_py.LookupException) as unwaited:
            buffer.lookup_transform("map", "robot", LATEST)
        with pytest.raises(tf2_py.LookupException) as caught:
            buffer.lookup_transform("map", "robot", LATEST, SHORT)
        assert str(caught.value) == f"{unwaited.value}. Waited 0.05 s"
        with pytest.raises(tf2_py.LookupException) as caught:
            buffer.lookup_transform_full("map", at(2), "robot", at(1), "map", SHORT)
        assert str(caught.value) == f"{unwaited.value}. Waited 0.05 s"
        with pytest.raises(tf2_py.LookupException) as caught:
            buffer.transform(point("robot"), "map", SHORT)
        assert str(caught.value) == f"{unwaited.value}. Waited 0.05 s"

    @pytest.mark.ours
    def test_of_two_halves_that_fail_the_same_one_is_told_with_a_wait_and_without(self, buffer, tf2_py):
        buffer.set_transform(transform("map", "robot", 1), "me")
        buffer.set_transform(transform("moon", "crater", 1), "me")
        for timeout in (Duration(), SHORT):
            # can_transform_full reports the target's half, which is an ExtrapolationException.
            with pytest.raises(tf2_py.ConnectivityException):
                buffer.lookup_transform_full("robot", at(2), "crater", at(1), "map", timeout)

    @pytest.mark.ours
    def test_a_timeout_of_zero_changes_no_error(self, buffer, tf2_py):
        # A wait would look for an invalid name first, as it would never end.
        buffer.set_transform(transform("map", "robot", 1), "me")
        for timeout in (Duration(), Duration(seconds=-1)):
            with pytest.raises(tf2_py.LookupException):
                buffer.lookup_transform("nowhere", "/robot", at(1), timeout)
            with pytest.raises(tf2_py.LookupException):
                buffer.lookup_transform_full("nowhere", at(1), "/robot", at(1), "map", timeout)

    @pytest.mark.ours
    def test_a_timeout_of_zero_needs_no_place_among_those_that_wait(self, tf2_ros, tf2_py):
        buffer = tf2_ros.Buffer(max_waiters=1)
        waiting = buffer.wait_for_transform_async("map", "robot", at(1))
        with pytest.raises(tf2_py.LookupException):
            buffer.lookup_transform("map", "robot", at(1), Duration())
        assert not waiting.done()

    @pytest.mark.ours
    def test_what_was_not_waited_for_does_not_say_so(self, buffer, tf2_py):
        for timeout in (Duration(), Duration(seconds=-1)):
            with pytest.raises(tf2_py.LookupException, match="is empty$"):
                buffer.lookup_transform("map", "robot", LATEST, timeout)
        with pytest.raises(tf2_py.InvalidArgumentException, match="cannot be empty$"):
            buffer.lookup_transform("", "robot", LATEST, LONG)

    @pytest.mark.ours
    def test_a_timeout_of_microseconds_is_one(self, buffer, tf2_py):
        timeout = Duration(nanoseconds=200_000)

        def look_up():
            return buffer.lookup_transform("map", "robot", LATEST, timeout)

        waited = [seconds_of(look_up) for _ in range(20)]
        # Polling, as tf2 does, takes 20 ms.
        assert 0.0002 <= min(seconds for seconds, _ in waited) < 0.02
        assert {type(error) for _, error in waited} == {tf2_py.LookupException}

    def test_a_negative_timeout_is_none(self, buffer, tf2_py):
        with pytest.raises(tf2_py.LookupException):
            buffer.lookup_transform("map", "robot", LATEST, Duration(seconds=-1))

    @pytest.mark.ours
    def test_a_name_that_can_never_be_found_is_not_waited_for(self, buffer, tf2_py):
        seconds, error = seconds_of(lambda: buffer.lookup_transform("/map", "robot", LATEST, LONG))
        assert type(error) is tf2_py.InvalidArgumentException
        assert seconds < PROMPT_S

    @pytest.mark.ours
    def test_a_timeout_that_is_none_is_refused(self, buffer):
        with pytest.raises(TypeError, match=r"timeout must be .*, not str: use Duration\(seconds=\.\.\.\)"):
            buffer.lookup_transform("map", "robot", LATEST, "1")
        with pytest.raises(TypeError, match="timeout is a Time"):
            buffer.lookup_transform("map", "robot", Duration(), at(1))

    @pytest.mark.ours
    def test_an_insert_without_waiters_costs_no_more(self, buffer, tf2_py):
        with pytest.raises(tf2_py.LookupException):
            buffer.lookup_transform("map", "robot", LATEST, SHORT)

    @pytest.mark.ours
    def test_it_waits_where_ros_was_never_started(self, buffer, later):
        later(buffer.set_transform, transform("map", "robot", 1), "me", when=waits(buffer))
        assert buffer.lookup_transform("map", "robot", at(1), LONG) is not None

    @pytest.mark.ours
    def test_many_threads_wait_at_once(self, buffer, later):
        found = []

        def look_up(seconds):
            found.append(stamp_ns(buffer.lookup_transform("map", "robot", at(seconds), LONG)))

        for seconds in range(1, 9):
            later(look_up, seconds)
        until(lambda: buffer.statistics()["waiters"] == 8)
        for seconds in range(1, 9):
            buffer.set_transform(transform("map", "robot", seconds), "me")
        until(lambda: len(found) == 8)
        assert sorted(found) == [seconds * 10**9 for seconds in range(1, 9)]


@pytest.mark.ours
class TestEndOfTheWait:
    def test_shutting_down_ends_it(self, ros, tf2_ros, later):
        buffer = tf2_ros.Buffer()
        later(ros.shutdown, when=waits(buffer))
        seconds, error = seconds_of(lambda: buffer.lookup_transform("map", "robot", LATEST, LONG))
        assert type(error) is tf2_ros.LookupException
        assert re.fullmatch(ENDED, str(error))
        assert seconds < PROMPT_S

    @pytest.mark.parametrize("link", ["node", "listener", "past listener", "listener of a node of its own"])
    def test_after_the_shutdown_of_what_fills_it_nothing_is_waited_for(self, ros, tf2_ros, node, link):
        buffer = tf2_ros.Buffer(node=node if link == "node" else None)
        if link != "node":
            listener = tf2_ros.TransformListener(buffer, None if link.endswith("own") else node)
            if link.startswith("past"):
                listener.unregister()
                del listener
        buffer.set_transform(transform("map", "robot", 1), "me")
        ros.shutdown()
        for look_up in (
            lambda: buffer.lookup_transform("map", "robot", at(5), LONG),
            lambda: buffer.lookup_transform_full("map", at(5), "robot", at(4), "map", LONG),
            lambda: buffer.transform(point("robot", 5), "map", LONG),
        ):
            seconds, error = seconds_of(look_up)
            assert type(error) is tf2_ros.ExtrapolationException
            assert re.fullmatch(ENDED, str(error))
            assert seconds < PROMPT_S
        can, reason = buffer.can_transform("map", "robot", at(5), LONG, return_debug_tuple=True)
        assert not can
        assert re.fullmatch(ENDED, reason)
        assert buffer.lookup_transform("map", "robot", at(1), LONG).child_frame_id == "robot"
        # What does not wait is not ended by it.
        with pytest.raises(tf2_ros.LookupException, match="does not exist(?!.*shut down)"):
            buffer.lookup_transform("map", "camera", LATEST, Duration())
        with pytest.raises(tf2_ros.InvalidArgumentException, match="cannot be empty$"):
            buffer.lookup_transform("map", "", LATEST, LONG)

    def test_what_a_program_fills_by_itself_is_waited_for_after_a_shutdown(self, ros, tf2_ros, later):
        buffer = tf2_ros.Buffer()
        ros.shutdown()
        later(buffer.set_transform, transform("map", "robot", 1), "me", when=waits(buffer))
        assert buffer.can_transform("map", "robot", LATEST, LONG)
        seconds, error = seconds_of(lambda: buffer.lookup_transform("map", "robot", at(5), SHORT))
        assert str(error).endswith("Waited 0.05 s")
        assert seconds >= 0.05

    @pytest.mark.parametrize("with_node", [False, True])
    def test_a_listener_of_a_context_that_goes_on_is_waited_for(
        self, ros, new_node, tf2_ros, node, later, with_node
    ):
        context = ros.Context()
        context.init(args=[])
        buffer = tf2_ros.Buffer(node=node if with_node else None)
        listener = tf2_ros.TransformListener(buffer, new_node("elsewhere", context=context))
        ros.shutdown()
        later(buffer.set_transform, transform("map", "robot", 1), "me", when=waits(buffer))
        assert buffer.can_transform("map", "robot", LATEST, LONG)
        later(context.shutdown, when=waits(buffer))
        assert re.fullmatch(ENDED, buffer.can_transform("map", "robot", at(5), LONG, True)[1])
        listener.unregister()

    def test_a_listener_that_gets_another_buffer_ties_that_to_its_context(self, ros, node, tf2_ros):
        buffer = tf2_ros.Buffer()
        listener = tf2_ros.TransformListener(tf2_ros.Buffer(), node)
        listener.buffer = buffer
        ros.shutdown()
        _, error = seconds_of(lambda: buffer.lookup_transform("map", "robot", LATEST, LONG))
        assert re.fullmatch(ENDED, str(error))

    @pytest.mark.parametrize("shut_down", [False, True])
    @pytest.mark.parametrize("name", ["", "/map"])
    def test_an_invalid_name_is_told_as_it_is(self, ros, tf2_ros, node, name, shut_down):
        buffer = tf2_ros.Buffer(node=node)
        if shut_down:
            ros.shutdown()
        with pytest.raises(tf2_ros.InvalidArgumentException, match=r"cannot (be empty|start with a '/')$"):
            buffer.lookup_transform(name, "robot", LATEST, SHORT)

    @pytest.mark.parametrize("timeout", [[], [SHORT]])
    def test_a_subclass_may_initialise_the_core_alone(self, tf2_py, tf2_ros, timeout):
        kind = type("Mine", (tf2_ros.Buffer,), {"__init__": tf2_py.BufferCore.__init__})
        with pytest.raises(tf2_py.LookupException, match="does not exist"):
            kind().lookup_transform("map", "robot", LATEST, *timeout)

    def test_its_node_may_be_of_another_class_without_a_context(self, tf2_ros, node):
        class Other:
            create_service = node.create_service
            get_clock = node.get_clock

        buffer = tf2_ros.Buffer(node=Other())
        assert not buffer.can_transform("map", "robot", LATEST, SHORT)
        node.destroy_service(buffer.srv)

    def test_a_context_that_starts_during_the_wait_ends_it_with_its_shutdown(self, ros, tf2_ros, later):
        ros.shutdown()
        buffer = tf2_ros.Buffer()

        def start_and_stop():
            ros.init(args=[])
            ros.shutdown()

        later(start_and_stop, when=waits(buffer))
        _, error = seconds_of(lambda: buffer.lookup_transform("map", "robot", LATEST, LONG))
        assert re.fullmatch(ENDED, str(error))

    def test_shutting_down_the_context_of_its_node_ends_it(self, ros, new_node, tf2_ros, later):
        context = ros.Context()
        context.init()
        node = new_node("elsewhere", context=context)
        buffer = tf2_ros.Buffer(node=node)
        later(context.shutdown, when=waits(buffer))
        assert not buffer.can_transform("map", "robot", LATEST, LONG)
        assert ros.ok()

    def test_ctrl_c_ends_it(self):
        program = start("blocked.py", stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        assert program.stdout.readline() == "waiting\n"
        program.send_signal(signal.SIGINT)
        _, errors = program.communicate(timeout=DEADLINE_S)
        assert errors.splitlines()[-1] == "KeyboardInterrupt"


class TestCanTransform:
    def test_yes_and_no_are_bools(self, buffer):
        assert not buffer.can_transform("map", "robot", LATEST)
        buffer.set_transform_static(transform("map", "robot"), "me")
        assert buffer.can_transform("map", "robot", LATEST)
        assert buffer.can_transform_full("map", at(2), "robot", at(1), "map")

    @pytest.mark.ours
    def test_the_type_of_the_answer_is_bool(self, buffer):
        assert buffer.can_transform("map", "map", LATEST) is True
        assert buffer.can_transform("map", "robot", LATEST) is False
        assert buffer.can_transform("map", "robot", LATEST, return_debug_tuple=True)[0] is False

    def test_the_reason_is_returned_on_request(self, buffer):
        can, reason = buffer.can_transform("map", "robot", LATEST, return_debug_tuple=True)
        assert not can
        assert "does not exist" in reason
        can, reason = buffer.can_transform_full("map", at(2), "robot", at(1), "map", return_debug_tuple=True)
        assert not can
        assert "does not exist" in reason

    def test_it_waits_in_vain(self, buffer):
        seconds, _ = seconds_of(lambda: buffer.can_transform("map", "robot", LATEST, SHORT))
        assert 0.05 <= seconds < PROMPT_S
        can, reason = buffer.can_transform_full("map", at(2), "robot", at(1), "map", SHORT, True)
        assert not can
        assert "does not exist" in reason

    @pytest.mark.ours
    def test_the_reason_says_how_long_was_waited(self, buffer):
        unwaited = buffer.can_transform("map", "robot", LATEST, return_debug_tuple=True)[1]
        reason = buffer.can_transform("map", "robot", LATEST, SHORT, return_debug_tuple=True)[1]
        assert reason == f"{unwaited}. Waited 0.05 s"
        reason = buffer.can_transform_full("map", at(2), "robot", at(1), "map", SHORT, True)[1]
        assert reason == f"{unwaited}. Waited 0.05 s"

    def test_a_bad_name_is_a_no(self, buffer):
        can, reason = buffer.can_transform("/map", "robot", LATEST, SHORT, return_debug_tuple=True)
        assert not can
        assert "cannot start with a '/'" in reason

    @pytest.mark.ours
    def test_it_wakes_when_the_transform_is_inserted(self, buffer, later):
        later(buffer.set_transform, transform("map", "robot", 1), "me", when=waits(buffer))
        assert buffer.can_transform("map", "robot", at(1), LONG, return_debug_tuple=True) == (True, "")


class TestNode:
    def test_its_service_returns_the_frames(self, tf2_ros, new_node, node, executor):
        buffer = tf2_ros.Buffer(node=node)
        buffer.set_transform_static(transform("map", "robot"), "somebody")
        asking = new_node("asking")
        executor.add_node(asking)
        client = asking.create_client(FrameGraph, "tf2_frames")
        until(client.service_is_ready, executor)
        future = client.call_async(FrameGraph.Request())
        until(future.done, executor)
        assert future.result().frame_yaml == buffer.all_frames_as_yaml()
        assert "somebody" in future.result().frame_yaml

    def test_the_cache_time_may_be_the_first_argument(self, tf2_ros, node):
        buffer = tf2_ros.Buffer(Duration(seconds=2), node)
        for seconds in (1, 4, 5):
            buffer.set_transform(transform("map", "robot", seconds), "me")
        assert not buffer.can_transform("map", "robot", at(1))
        assert buffer.can_transform("map", "robot", at(4))

    @pytest.mark.ours
    def test_it_has_the_clock_of_its_node(self, tf2_ros, node):
        assert tf2_ros.Buffer(node=node).clock is node.get_clock()

    @pytest.mark.ours
    @pytest.mark.parametrize("with_node", [False, True])
    def test_a_dropped_buffer_is_freed_at_once(self, tf2_ros, node, with_node):
        buffer = tf2_ros.Buffer(node=node if with_node else None)
        if with_node:
            node.destroy_service(buffer.srv)
        reference = weakref.ref(buffer)
        del buffer
        gc.collect()
        assert reference() is None
        # The clock must have forgotten it, too: it would call into freed memory.
        node.set_parameters([Parameter("use_sim_time", value=True)])


@pytest.mark.ours
class TestTimeJump:
    @pytest.fixture
    def full(self, tf2_ros, node):
        buffer = tf2_ros.Buffer(node=node)
        buffer.set_transform(transform("map", "robot", 1), "me")
        buffer.set_transform_static(transform("robot", "camera"), "me")
        return buffer

    def test_switching_sim_time_on_and_off_clears_and_says_so(self, full, node, capfd):
        node.set_parameters([Parameter("use_sim_time", value=True)])
        assert not full.can_transform("map", "robot", LATEST)
        assert full.can_transform("robot", "camera", LATEST)
        assert "Simulated time was switched on" in capfd.readouterr().err
        full.set_transform(transform("map", "robot", 1), "me")
        node.set_parameters([Parameter("use_sim_time", value=False)])
        assert not full.can_transform("map", "robot", LATEST)
        assert "Simulated time was switched off" in capfd.readouterr().err

    def test_a_jump_back_of_a_second_clears_and_says_so(self, full, node, capfd):
        node.set_parameters([Parameter("use_sim_time", value=True)])
        clock = node.get_clock()
        clock.set_ros_time_override(Time(seconds=100, clock_type=clock.clock_type))
        full.set_transform(transform("map", "robot", 1), "me")
        for seconds in (200, 199.5):
            clock.set_ros_time_override(Time(seconds=seconds, clock_type=clock.clock_type))
            assert full.can_transform("map", "robot", LATEST)
        capfd.readouterr()
        clock.set_ros_time_override(Time(seconds=198.5, clock_type=clock.clock_type))
        assert not full.can_transform("map", "robot", LATEST)
        assert "jump back in time by 1.000 s" in capfd.readouterr().err

    def test_a_subclass_may_do_otherwise(self, tf2_ros, node):
        seen = []

        class Mine(tf2_ros.Buffer):
            def time_jump_callback(self, time_jump):
                seen.append(time_jump.clock_change)

        buffer = Mine(node=node)
        node.set_parameters([Parameter("use_sim_time", value=True)])
        assert seen == [ClockChange.ROS_TIME_ACTIVATED]
        assert buffer.jump_handle is not None

    def test_it_may_be_called_with_nothing(self, full):
        full.set_transform(transform("map", "robot", 1), "me")
        full.time_jump_callback(None)
        assert not full.can_transform("map", "robot", LATEST)

    def test_the_callback_may_be_called_by_hand(self, full):
        full.time_jump_callback(TimeJump(ClockChange.ROS_TIME_NO_CHANGE, Duration(seconds=-3)))
        assert not full.can_transform("map", "robot", LATEST)


def test_latest_is_what_is_latest_when_a_coroutine_resumes(buffer):
    coroutine = buffer.lookup_transform_async("map", "robot", LATEST)
    coroutine.send(None)
    buffer.set_transform(transform("map", "robot", 1), "me")
    buffer.set_transform(transform("map", "robot", 2), "me")
    with pytest.raises(StopIteration) as stop:
        coroutine.send(None)
    assert stamp_ns(stop.value.value) == 2 * 10**9


@pytest.mark.ours
def test_its_finalizer_may_be_called_by_hand(tf2_ros):
    buffer = tf2_ros.Buffer()
    buffer.__del__()
    buffer.__del__()
