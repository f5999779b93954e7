"""What errors, warnings and the repr of a listener say of what was received."""

import gc
import re

import pytest
from making import at, transform
from processes import until
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from rclpy.time import Time

from tf2_msgs.msg import TFMessage
from tf2_py import TransformException

pytestmark = pytest.mark.ours

S = 10**9
LATEST = Time()
ONE_MESSAGE = re.compile(r": 1 message, last \d+\.\d+ s ago")
NOTHING = "nothing has been received on /tf and /tf_static"


@pytest.fixture(autouse=True, params=["inbox", "executor"])
def inserter(request, monkeypatch):
    """What inserts the transforms of a listener: its inbox, or the executor that spins the node."""
    if request.param == "executor":
        monkeypatch.setattr("tf2_ros._receive.receiver.problem", lambda: "it is new")
    return request.param


@pytest.fixture(autouse=True)
def slow_machine(monkeypatch):
    """No topic falls silent between two steps of a test."""
    monkeypatch.setattr("tf2_ros._receive.reception.SILENT_S", 1000)


@pytest.fixture
def buffer(tf2_ros):
    return tf2_ros.Buffer()


def error(buffer, target="map", source="robot", time=LATEST):
    """The text of the error of a lookup."""
    with pytest.raises(TransformException) as caught:
        buffer.lookup_transform(target, source, time)
    return str(caught.value)


class TestErrors:
    def test_an_empty_buffer_with_a_listener_names_its_topics(self, tf2_ros, buffer, node):
        tf2_ros.TransformListener(buffer, node)
        assert error(buffer) == (
            '"map" passed to lookupTransform argument target_frame does not exist. '
            f"The buffer is empty: {NOTHING}"
        )
        assert buffer.can_transform("map", "robot", LATEST, return_debug_tuple=True)[1].endswith(NOTHING)

    def test_without_a_listener_it_is_empty_alone(self, buffer):
        assert error(buffer).endswith("does not exist. The buffer is empty")

    def test_after_the_end_of_the_listener_its_topics_are_not_named(self, tf2_ros, buffer, node):
        with tf2_ros.TransformListener(buffer, node):
            assert NOTHING in error(buffer)
        until(lambda: error(buffer).endswith("The buffer is empty"))

    def test_the_topics_are_those_that_the_names_resolve_to(self, tf2_ros, buffer, new_node):
        remapped = ["-r", "__ns:=/robot1", "-r", "/tf:=tf", "-r", "/tf_static:=tf_static"]
        node = new_node("listening", cli_args=["--ros-args", *remapped])
        tf2_ros.TransformListener(buffer, node)
        assert error(buffer).endswith("received on /robot1/tf and /robot1/tf_static")

    def test_a_static_listener_has_one_topic(self, tf2_ros, buffer, node):
        tf2_ros.StaticTransformListener(buffer, node, tf_static_topic="/mine")
        assert error(buffer).endswith("nothing has been received on /mine")

    def test_a_wait_that_times_out_tells_it_too(self, tf2_ros, buffer, node):
        tf2_ros.TransformListener(buffer, node)
        future = buffer.wait_for_transform_async("map", "robot", LATEST, timeout=Duration(seconds=0.01))
        until(future.done)
        assert isinstance(future.exception(), tf2_ros.TimeoutException)
        assert NOTHING in str(future.exception())

    def test_only_the_silent_topics_are_named(self, tf2_ros, buffer, node, executor, peer):
        tf2_ros.TransformListener(buffer, node)
        peer().send(("map", "arm", 1 * S, 1))
        silence = "Nothing has been received on /tf_static"
        until(lambda: error(buffer).endswith("does not exist. " + silence), executor)
        peer().send(("map", "tool", 1 * S, 1), static=True)
        until(lambda: error(buffer).endswith("does not exist"), executor)

    @pytest.mark.parametrize("simulated", [False, True])
    def test_a_topic_that_falls_silent_is_named_with_the_seconds(
        self, tf2_ros, new_node, executor, peer, monkeypatch, simulated
    ):
        monkeypatch.setattr("tf2_ros._receive.reception.SILENT_S", 1)
        node = new_node("silent", parameter_overrides=[Parameter("use_sim_time", value=simulated)])
        executor.add_node(node)
        buffer = tf2_ros.Buffer(node=node)
        tf2_ros.TransformListener(buffer, node)
        publisher = peer()
        publisher.send(("map", "arm", 1 * S, 1), ("map", "arm", 2 * S, 1))
        publisher.send(("other", "tool", 1 * S, 1), static=True)

        def error_at_any_time(*asked):
            return re.sub(r"for \d+ s$", "for 1 s", error(buffer, *asked))

        # In steady time: no simulated clock is published here.
        silence = "nothing has been received on /tf for 1 s"
        until(lambda: error_at_any_time().endswith(f"does not exist. {silence.capitalize()}"), executor)
        assert error_at_any_time("map", "arm", at(9)).endswith("of arm in map; " + silence)
        assert error_at_any_time("map", "tool").endswith("that of tool is other. " + silence.capitalize())
        # What is received now does not help with the past.
        assert error(buffer, "map", "arm", at(0.5)).endswith("of arm in map")
        publisher.send(("map", "arm", 3 * S, 1))
        until(lambda: error(buffer, "map", "arm", at(9)).endswith("of arm in map"), executor)

    def test_what_was_received_just_now_is_not_denied(self, tf2_ros, buffer, node):
        listener = tf2_ros.TransformListener(buffer, node)
        assert error(buffer, "map", "arm").endswith(NOTHING)
        listener.callback(TFMessage(transforms=[transform("map", "arm", 5)]))
        assert error(buffer).endswith("does not exist. Nothing has been received on /tf_static")
        assert error(buffer, "map", "arm", at(9)).endswith("of arm in map")

    @pytest.mark.parametrize("kind", ["unconnected", "extrapolation"])
    def test_nor_where_it_named_no_new_frame(self, tf2_ros, buffer, node, kind):
        buffer.set_transform(transform("map", "arm", 5), "me")
        buffer.set_transform(transform("other", "tool", 5), "me")
        listener = tf2_ros.TransformListener(buffer, node)
        frames = ("map", "tool" if kind == "unconnected" else "arm")
        assert "nothing has been received on /tf" in error(buffer, *frames, at(9)).lower()
        listener.callback(TFMessage(transforms=[transform("map", "arm", 6)]))
        listener.static_callback(TFMessage())
        assert "received" not in error(buffer, *frames, at(9))

    def test_after_a_shutdown_no_topic_is_called_silent(self, tf2_ros, buffer, new_node):
        context = Context()
        context.init(args=[])
        listener = tf2_ros.TransformListener(buffer, new_node("first", context=context))
        context.shutdown()
        assert error(buffer).endswith("The buffer is empty")
        del listener

    def test_static_topics_do_not_fall_silent(self, tf2_ros, buffer, node, executor, peer, monkeypatch):
        monkeypatch.setattr("tf2_ros._receive.reception.SILENT_S", 0)
        tf2_ros.TransformListener(buffer, node)
        peer().send(("map", "tool", 1 * S, 1), static=True)
        until(lambda: error(buffer).endswith("does not exist. Nothing has been received on /tf"), executor)

    def test_messages_of_no_transforms_count(self, tf2_ros, buffer, node, executor, peer):
        tf2_ros.TransformListener(buffer, node)
        peer().send()
        until(lambda: error(buffer).endswith("empty: nothing has been received on /tf_static"), executor)

    def test_a_buffer_that_is_set_later_is_told_too(self, tf2_ros, buffer, node):
        listener = tf2_ros.TransformListener(tf2_ros.Buffer(), node)
        assert error(buffer).endswith("The buffer is empty")
        listener.buffer = buffer
        assert error(buffer).endswith(NOTHING)

    def test_nothing_is_claimed_where_a_program_handles_the_messages(self, tf2_ros, buffer, node):
        class Mine(tf2_ros.TransformListener):
            def callback(self, data):
                pass

        Mine(buffer, node)
        assert error(buffer).endswith("nothing has been received on /tf_static")

    def test_buffers_of_another_class_need_nothing(self, tf2_ros, node, executor, peer):
        class Mine:
            def __init__(self):
                self.seen = []

            def set_transform(self, transform, authority):
                self.seen.append(transform.child_frame_id)

            set_transform_static = set_transform

        mine = Mine()
        listener = tf2_ros.TransformListener(mine, node)
        peer().send(("map", "robot", 1 * S, 1))
        until(lambda: mine.seen == ["robot"], executor)
        assert ONE_MESSAGE.search(repr(listener))


@pytest.fixture
def warnings(capfd):
    """Reads what was logged, since it was read last, about several listeners of a buffer."""

    def read():
        gc.collect()
        return [line for line in capfd.readouterr().err.splitlines() if "Two listeners" in line]

    return read


class TestTwoListeners:
    def test_of_one_buffer_and_topic_warn_once(self, tf2_ros, buffer, node, new_node, warnings):
        first = tf2_ros.TransformListener(buffer, node)
        assert warnings() == []
        second = tf2_ros.TransformListener(buffer, new_node("another"))
        [line] = warnings()
        assert "Two listeners of /another and /listening fill one Buffer" in line
        assert line.endswith(f"(at {id(buffer):#x}) from /tf and /tf_static: one is enough")
        third = tf2_ros.TransformListener(buffer, node)
        assert warnings() == []
        assert len({first, second, third}) == 3

    def test_only_the_topics_that_both_receive_are_named(self, tf2_ros, buffer, node, warnings):
        tf2_ros.TransformListener(buffer, node)
        tf2_ros.StaticTransformListener(buffer, node)
        [line] = warnings()
        assert " of /listening fill one Buffer" in line and line.endswith(" from /tf_static: one is enough")

    def test_buffers_of_other_classes_count(self, tf2_ros, node, warnings):
        class Mine:
            __slots__ = ()

            def set_transform(self, transform, authority):
                pass

            set_transform_static = set_transform

        mine = Mine()
        listeners = [tf2_ros.TransformListener(mine, node) for _ in range(2)]
        [line] = warnings()
        assert "fill one Mine" in line and len(listeners) == 2

    def test_of_two_buffers_do_not_warn(self, tf2_ros, buffer, node, warnings):
        tf2_ros.TransformListener(buffer, node)
        tf2_ros.TransformListener(tf2_ros.Buffer(), node)
        assert warnings() == []

    def test_of_two_namespaces_do_not_warn(self, tf2_ros, buffer, node, warnings):
        for robot in ("robot1", "robot2"):
            tf2_ros.TransformListener(
                buffer, node, tf_topic=f"/{robot}/tf", tf_static_topic=f"/{robot}/tf_static"
            )
        assert warnings() == []

    def test_of_two_domains_do_not_warn(self, tf2_ros, buffer, node, new_node, warnings):
        tf2_ros.TransformListener(buffer, node)
        other = Context()
        other.init(args=[], domain_id=node.context.get_domain_id() + 101)
        try:
            listener = tf2_ros.TransformListener(buffer, new_node("elsewhere", context=other))
            assert warnings() == []
            listener.unregister()
        finally:
            other.shutdown()

    @pytest.mark.parametrize("how", ["unregister", "destroy", "node"])
    def test_one_after_the_end_of_the_other_does_not_warn(self, tf2_ros, buffer, new_node, warnings, how):
        node = new_node("first")
        first = tf2_ros.TransformListener(buffer, node)
        if how == "unregister":
            first.unregister()
        elif how == "destroy":
            node.destroy_subscription(first.tf_sub)
            node.destroy_subscription(first.tf_static_sub)
        else:
            node.destroy_node()
        tf2_ros.TransformListener(buffer, new_node("second"))
        assert warnings() == []

    def test_a_listener_that_changes_to_the_buffer_of_another_warns(self, tf2_ros, buffer, node, warnings):
        tf2_ros.TransformListener(buffer, node)
        second = tf2_ros.TransformListener(tf2_ros.Buffer(), node)
        assert warnings() == []
        second.buffer = buffer
        assert len(warnings()) == 1

    def test_one_after_the_shutdown_of_the_other_does_not_warn(self, tf2_ros, buffer, new_node, warnings):
        context = Context()
        context.init(args=[])
        first = tf2_ros.TransformListener(buffer, new_node("first", context=context))
        context.shutdown()
        assert warnings() == []
        second = tf2_ros.TransformListener(buffer, new_node("second"))
        assert warnings() == []
        tf2_ros.TransformListener(buffer, new_node("third"))
        [line] = warnings()
        assert "Two listeners of /second and /third" in line
        assert first is not second

    def test_that_is_told_once_of_two(self, tf2_ros, buffer, node, warnings):
        tf2_ros.TransformListener(buffer, node)
        second = tf2_ros.TransformListener(tf2_ros.Buffer(), node)
        for _ in range(3):
            second.buffer = buffer
        assert len(warnings()) == 1
        second.buffer = tf2_ros.Buffer()
        second.buffer = buffer
        assert warnings() == []


class TestRepr:
    def test_it_counts_messages_by_topic(self, tf2_ros, buffer, node, executor, peer, inserter):
        listener = tf2_ros.TransformListener(buffer, node)
        state = "" if inserter == "inbox" else ", taken by an executor"
        of = "<tf2_ros.TransformListener of"
        assert repr(listener) == f"{of} /tf: 0 messages{state}; /tf_static: 0 messages{state}>"
        publisher = peer()
        publisher.send(("map", "robot", 1 * S, 1), ("map", "arm", 1 * S, 1))
        publisher.send(("map", "tool", 0, 1), static=True)
        until(lambda: len(ONE_MESSAGE.findall(repr(listener))) == 2, executor)
        assert repr(listener).endswith(f" s ago{state}>")

    def test_it_names_the_topic_that_an_executor_takes(self, tf2_ros, buffer, node, inserter):
        class Mine(tf2_ros.TransformListener):
            def callback(self, data):
                pass

        listener = Mine(buffer, node)
        rest = "" if inserter == "inbox" else ", taken by an executor"
        assert repr(listener).endswith(
            f"of /tf: messages not counted, taken by an executor; /tf_static: 0 messages{rest}>"
        )
        assert listener.receives == (("/tf_static",) if inserter == "inbox" else ())

    def test_it_names_the_class_and_the_topics(self, tf2_ros, buffer, node):
        listener = tf2_ros.StaticTransformListener(buffer, node, tf_static_topic="/mine")
        assert repr(listener).startswith("<tf2_ros.StaticTransformListener of /mine: 0 messages")

    def test_it_works_before_and_after_the_life_of_the_listener(self, tf2_ros, buffer, node):
        assert repr(tf2_ros.TransformListener.__new__(tf2_ros.TransformListener)) == (
            "<tf2_ros.TransformListener, not initialised>"
        )
        listener = tf2_ros.TransformListener(buffer, node)
        listener.unregister()
        assert repr(listener).endswith("of /tf: 0 messages, ended; /tf_static: 0 messages, ended>")
        node.destroy_node()
        assert repr(listener).endswith(", ended>")

    def test_it_works_after_the_end_of_the_context(self, tf2_ros, buffer, node, ros, inserter):
        listener = tf2_ros.TransformListener(buffer, node)
        ros.shutdown()
        # Kilted's shutdown destroys the node, and so the listener.
        if inserter == "inbox":
            assert repr(listener).endswith("0 messages, ended>")
        else:
            assert repr(listener).endswith((", taken by an executor>", ", ended>"))

    def test_a_hidden_node_may_be_gone(self, tf2_ros, buffer, ros):
        with tf2_ros.TransformListener(buffer, None) as listener:
            assert "0 messages" in repr(listener)
        assert repr(listener).endswith(", ended>")

    def test_calls_by_hand_count(self, tf2_ros, buffer, node):
        listener = tf2_ros.TransformListener(buffer, node)
        listener.callback(TFMessage(transforms=[transform("map", "robot", 1)]))
        assert ONE_MESSAGE.search(repr(listener))
