# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What errors, warnings and the repr of a listener say of what was received."""

import copy
import re

import pytest
from rclpy.parameter import Parameter
from rclpy.time import Time
from times_and_transforms import at, transform
from waiting import until, until_told

from tf2_py import TransformException

pytestmark = pytest.mark.usefixtures("inserter")

S = 10**9
LATEST = Time()
ONE_MESSAGE = re.compile(r": 1 message, last \d+\.\d+ s ago")
NOTHING = "nothing has been received on /tf or on /tf_static"


@pytest.fixture(autouse=True)
def slow_machine(monkeypatch):
    """No topic falls silent between two steps of a test."""
    monkeypatch.setattr("tf2_ros._sources.SILENT_S", 1000)


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

    def test_a_buffer_that_nothing_ever_fills_says_that_it_has_no_listener(self, tf2_ros, buffer):
        reason = "The buffer is empty: it has no TransformListener and nothing was inserted"
        assert error(buffer).endswith(f"does not exist. {reason}")
        future = buffer.wait_for_transform_async("map", "robot", LATEST, timeout=0.01)
        until(future.done)
        assert reason in str(future.exception())
        assert error(copy.copy(buffer)).endswith(reason)
        filled, known = tf2_ros.Buffer(), tf2_ros.Buffer()
        filled.set_transform(transform("map", "robot", 1), "me")
        filled.forget("robot")
        known.add_source("the simulator")
        for one in (filled, known):
            assert error(one).endswith("The buffer is empty")

    def test_after_the_end_of_the_listener_its_topics_are_not_named(self, tf2_ros, buffer, node):
        with tf2_ros.TransformListener(buffer, node):
            assert NOTHING in error(buffer)
        until(lambda: error(buffer).endswith("The buffer is empty"))

    def test_another_buffer_that_the_listener_fills_from_now_on_names_its_topics(self, tf2_ros, buffer, node):
        other = tf2_ros.Buffer()
        listener = tf2_ros.TransformListener(buffer, node)
        listener.buffer = other
        assert error(other).endswith(f"The buffer is empty: {NOTHING}")
        assert error(buffer).endswith("The buffer is empty")

    def test_the_topics_are_those_that_the_names_resolve_to(self, tf2_ros, buffer, new_node):
        remapped = ["-r", "__ns:=/robot1", "-r", "/tf:=tf", "-r", "/tf_static:=tf_static"]
        node = new_node("listening", cli_args=["--ros-args", *remapped])
        tf2_ros.TransformListener(buffer, node)
        assert error(buffer).endswith("received on /robot1/tf or on /robot1/tf_static")

    def test_a_static_listener_has_one_topic(self, tf2_ros, buffer, node):
        tf2_ros.StaticTransformListener(buffer, node, tf_static_topic="/mine")
        assert error(buffer).endswith("nothing has been received on /mine")

    def test_only_the_silent_topics_are_named(self, tf2_ros, buffer, node, executor, peer):
        tf2_ros.TransformListener(buffer, node)
        peer().send(("map", "arm", 1 * S, 1))
        silence = "Nothing has been received on /tf_static"
        until(lambda: error(buffer).endswith("does not exist. " + silence), executor)
        peer().send(("map", "tool", 1 * S, 1), static=True)
        until(lambda: error(buffer).endswith("does not exist"), executor)

    def test_a_topic_in_another_namespace_that_has_transforms_is_named(
        self, tf2_ros, buffer, node, executor, peer
    ):
        tf2_ros.TransformListener(buffer, node)
        peer("-r", "/tf:=/robot1/tf", "-r", "/tf_static:=/unused")
        instead = (
            " (transforms are published on /robot1/tf: add --ros-args -r /tf:=/robot1/tf to a node "
            "or --namespace robot1 to a command)"
        )
        until(lambda: error(buffer).endswith(f"received on /tf{instead} or on /tf_static"), executor)
        peer().send(("map", "arm", 1 * S, 1))
        until(lambda: error(buffer).endswith("exist. Nothing has been received on /tf_static"), executor)

    def test_a_publisher_of_another_type_is_named(self, tf2_ros, buffer, node, executor, peer):
        tf2_ros.TransformListener(buffer, node)
        peer("-r", "/board:=/tf", "-r", "/tf:=/unused").send_text("/board")
        said = " publishes std_msgs/msg/String there) or on /tf_static"
        until(lambda: error(buffer).endswith(said), executor)
        until_told(lambda: error(buffer).endswith(f"received on /tf (/peer{said}"), executor)

    @pytest.mark.parametrize("simulated", [False, True])
    def test_a_topic_that_falls_silent_is_named_with_the_seconds(
        self, tf2_ros, new_node, executor, peer, monkeypatch, simulated
    ):
        monkeypatch.setattr("tf2_ros._sources.SILENT_S", 1)
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
        assert error_at_any_time("map", "arm", at(9)).endswith("is 7.000000000 s too old; " + silence)
        assert error_at_any_time("map", "tool").endswith("the root of tool is other. " + silence.capitalize())
        # What is received now does not help with the past.
        assert error(buffer, "map", "arm", at(0.5)).endswith(
            "(parent map) at 1.000000000 is 0.500000000 s too new"
        )

        def has_noticed_the_end_of_silence():
            publisher.send(("map", "arm", 3 * S, 1))
            return error(buffer, "map", "arm", at(9)).endswith("is 6.000000000 s too old")

        until(has_noticed_the_end_of_silence, executor)


class TestRepr:
    def test_it_counts_messages_by_topic(self, tf2_ros, buffer, node, executor, peer):
        listener = tf2_ros.TransformListener(buffer, node)
        assert repr(listener) == "<tf2_ros.TransformListener of /tf: 0 messages; /tf_static: 0 messages>"
        publisher = peer()
        publisher.send(("map", "robot", 1 * S, 1), ("map", "arm", 1 * S, 1))
        publisher.send(("map", "tool", 0, 1), static=True)
        until(lambda: len(ONE_MESSAGE.findall(repr(listener))) == 2, executor)
        listener.unregister()
        assert repr(listener).count(" s ago, ended") == 2

    def test_it_does_not_count_what_a_program_handles(self, tf2_ros, buffer, node):
        class Mine(tf2_ros.TransformListener):
            def callback(self, data):
                pass

        listener = Mine(buffer, node)
        assert repr(listener).endswith("of /tf: messages not counted; /tf_static: 0 messages>")
        assert listener.receives == ()
        assert error(buffer).endswith("nothing has been received on /tf_static")
