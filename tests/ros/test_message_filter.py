# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages that wait for their transforms."""

import asyncio
import gc
import re
import sys
import threading
from collections import Counter
from decimal import Decimal
from functools import partial
from types import SimpleNamespace

import pytest
from calls_in_threads import at_once
from cdr_encoder import encode
from geometry_msgs.msg import PointStamped
from helper_threads import let_helper_threads_finish
from hypothesis import given
from hypothesis import strategies as st
from rclpy.duration import Duration, Infinite
from rclpy.time import Time
from spinning_nodes import spinning
from std_msgs.msg import Header
from times_and_transforms import S, at, transform
from waiting import DEADLINE_S, errors_so_far, until

from tf2_ros._wait import call_queue
from tf2_ros._wait.call_runners import call_queue_of


def point(word="1"):
    """A message of a second, as in ``1.5``, from ``lidar``, or as in ``1.5@camera``."""
    seconds, at_sign, frame = word.partition("@")
    message = PointStamped()
    message.header.frame_id = frame if at_sign else "lidar"
    message.header.stamp = Time(nanoseconds=int(Decimal(seconds) * S)).to_msg()
    return message


def word_of(message):
    seconds, frame = Time.from_msg(message.header.stamp).nanoseconds / S, message.header.frame_id
    return f"{seconds:.9g}" if frame == "lidar" else f"{seconds:.9g}@{frame}"


def insert(buffer, seconds=1.0, parent="map", child="lidar", x=0.0):
    buffer.set_transform(transform(parent, child, seconds, (x, 0, 0)), "me")


class Script:
    """
    Runs scripts of events and expected outcomes on one filter.

    | word | event, or what is expected |
    |---|---|
    | ``M2``, ``M2@camera`` | a message of second 2 arrives, from ``lidar`` or from another frame |
    | ``T1.5``, ``T1:odom>map`` | a transform of second 1.5 is inserted: ``lidar`` in ``map``, or others |
    | ``T1,2``, ``T1,2:odom>map`` | transforms of these seconds are inserted by one call |
    | ``C100`` | the buffer's clock shows second 100 |
    | ``forget`` | the buffer is cleared |
    | ``clear``, ``close`` | the filter is cleared, or closed |
    | ``=1,2@camera`` | these messages have passed since the last such word, in this order; ``=``: none |
    | ``!TIMEOUT:1,2`` | these were dropped for this reason since the last such word |

    At the end of a script, nothing may have passed or been dropped that was not expected.
    """

    def __init__(self, tf2_ros, node, input=None, frames="map", queue_size=0, **options):
        self.buffer, targets = tf2_ros.Buffer(Duration(seconds=10)), frames.split()
        self.passed, self.dropped = [], []  # since they were last expected
        self.filter = tf2_ros.MessageFilter(input, self.buffer, targets, queue_size, node=node, **options)
        self.filter.registerCallback(lambda message: self.passed.append(message))
        self.filter.registerFailureCallback(lambda m, reason: self.dropped.append((reason.name, m)))

    def run(self, script):
        for word in script.split():
            self.step(word)
        assert (self.passed, self.dropped) == ([], [])

    def step(self, word):
        name, _, argument = word.partition(":")
        if word[0] == "M":
            self.filter.add(point(word[1:]))
        elif word[0] == "T":
            self.buffer.set_transforms(links(word), "me")
        elif word[0] == "C":
            self.buffer.clock = SimpleNamespace(now=lambda: at(float(word[1:])))
        elif word[0] == "=":
            assert list(map(word_of, taken(self.passed))) == list(filter(None, word[1:].split(",")))
        elif word[0] == "!":
            expected = [(name[1:], message) for message in argument.split(",")]
            until(lambda: len(self.dropped) >= len(expected))
            assert [(reason, word_of(m)) for reason, m in taken(self.dropped)] == expected
        else:
            {"forget": self.buffer.clear, "clear": self.filter.clear, "close": self.filter.close}[word]()


def links(word):
    """The transforms of a word."""
    name, _, frames = word.partition(":")
    parent, child = frames.split(">") if frames else ("map", "lidar")
    return [transform(parent, child, float(seconds)) for seconds in name[1:].split(",")]


def taken(found):
    """A copy of a list, which is emptied."""
    copy = list(found)
    found.clear()
    return copy


@pytest.fixture
def make(tf2_ros, node):
    made = []

    def make(**options):
        made.append(Script(tf2_ros, node, **options))
        return made[-1]

    yield make
    for script in made:
        script.filter.close()
        assert adds_up(script.filter.statistics())
        let_helper_threads_finish()
        assert script.buffer.statistics()["waiters"] == 0, "somebody is left waiting"


def adds_up(counts):
    ended = counts["passed"] + sum(counts["dropped"].values()) + counts["cleared"]
    return counts["received"] == ended + counts["waiting"]


@pytest.mark.parametrize(
    ("options", "script"),
    [
        # A message waits for the transforms around its stamp.
        ({}, "M2 T1 = T3 =2"),
        ({}, "T1 M1 =1 M9@map =9@map"),
        ({"frames": "/map"}, "M1@/lidar T1 =1@/lidar"),
        # They pass in the order in which their transforms complete.
        ({}, "M4 M2 M3 M1 M1@camera T1 =1 T1:map>camera =1@camera T3 =2,3 T5 =4"),
        # Time 0 is the latest.
        ({"tolerance": Duration(seconds=1)}, "M0 T5 =0"),
        # Several target frames are all needed, each at any moment.
        ({"frames": "map odom earth"}, "M1 T1 T1:earth>map = T1:odom>earth =1"),
        ({"frames": "map mirror"}, "T1 M11 T12,40,41 = T11:lidar>mirror =11"),
        # With a tolerance, transforms are needed for later, too.
        ({"tolerance": Duration(seconds=0.5)}, "M1 T1 T1.4 = T1.5 =1"),
        ({"tolerance": Duration(seconds=5)}, "T1 M11 T12,25,26 =11"),
        # Each insert is judged before the next one prunes, also within one call.
        ({}, "T1 M11 T12,40,41 =11"),
        ({}, "M11 T1,12,40,1 =11"),
        ({}, "T1:map>odom T1:odom>lidar M11 T12,40,41:odom>lidar T12:map>odom !OUT_THE_BACK:11"),
        # The queue has a size; what need not wait drops nothing.
        ({"queue_size": 2}, "M1 M2 M3 M4 !QUEUE_FULL:1,2 T1 T5 =3,4"),
        ({"queue_size": 1}, "M9 T1 M1 M1 =1,1 clear T11 ="),
        ({}, "M1 clear T1 = M1 =1"),
        ({}, "M1 close T1 = M1 = close"),
        # Reasons for which messages are dropped.
        ({}, "M1@ M2@/ !EMPTY_FRAME_ID:1@,2@/"),
        ({}, "M1@//lidar !NO_TRANSFORM_FOUND:1@//lidar"),
        ({"tolerance": Duration(seconds=1)}, "M2147483647.5 !NO_TRANSFORM_FOUND:2.14748365e+09"),
        ({"buffer_timeout": Infinite}, "M1 T1 =1"),
        ({"buffer_timeout": 0.05}, "T1 M2 !TIMEOUT:2 T3 = M3 =3"),
        ({"buffer_timeout": 2.0}, "T1 M2 T2 =2 M3 !TIMEOUT:3"),
        ({"buffer_timeout": Duration()}, "M1 !NO_TRANSFORM_FOUND:1 T1 M1 =1"),
        ({}, "T20 T21 M10.9 !OUT_THE_BACK:10.9 M11 = T11 =11"),
        ({}, "M1 T20 !OUT_THE_BACK:1 M20 =20"),
        ({}, "M11 T12 T21 = T21.1 !OUT_THE_BACK:11"),
        ({}, "M11 T12,21,30,31 !OUT_THE_BACK:11"),
        ({}, "M11 M12 T29 !OUT_THE_BACK:11,12 M11 !OUT_THE_BACK:11"),
        ({}, "M0 T29 =0"),
        ({"frames": "map odom"}, "M11 T29 !OUT_THE_BACK:11"),
        ({"tolerance": Duration(seconds=8)}, "T20 M11 = T29.5 !OUT_THE_BACK:11"),
        ({"buffer_timeout": Duration()}, "T29 M11 !OUT_THE_BACK:11"),
        # Not while the frames may still be connected in another way.
        ({}, "M11 T29:odom>lidar = T29:map>odom !OUT_THE_BACK:11"),
        ({}, "M11 T29:odom>lidar = forget T11 =11"),
        # The path may lack data of another frame, too.
        ({}, "T5:map>odom T29:odom>lidar M11 !OUT_THE_BACK:11"),
        ({}, "T1:map>odom T29:map>odom T12:odom>lidar M11 = T30:odom>lidar !OUT_THE_BACK:11"),
        # A policy accepts other transforms, and a limit that could never apply drops what would pass.
        ({"policy": {"tolerance": 0.5}}, "T1 M1.4 =1.4 M1.6 = T1.2 =1.6"),
        ({"policy": {"tolerance": {"odom": 1}}}, "T1:map>odom T1:odom>lidar M1.5 = T1.6:odom>lidar =1.5"),
        ({"policy": {"tolerance": 0.2}, "tolerance": 0.5}, "T1 M1 = T1.3 =1"),
        ({"policy": {"tolerance": 0.5}}, "T5 M1 = T29 !OUT_THE_BACK:1"),
        ({"policy": {"tolerance": {"ladar": 1}}}, "T1 M1 !NO_TRANSFORM_FOUND:1"),
        ({"policy": {"tolerance": {"ladar": 1}}}, "M1 T1 !NO_TRANSFORM_FOUND:1"),
        ({"policy": {"tolerance": {"ladar": 1}}, "tolerance": 1}, "M1 T1,2 !NO_TRANSFORM_FOUND:1"),
        # A gap ends when it is filled, or can no longer be.
        ({"policy": {"max_gap": 2}}, "T1 T5 M3 = T3.5 = T2.5 =3"),
        ({"policy": {"max_gap": 2}}, "M3 T1 T5 = T13 = T13.1 !OUT_THE_BACK:3"),
        ({"policy": {"max_gap": 2}, "tolerance": 1}, "T1 T2 T5 M2 = T4 =2"),
        ({"policy": {"max_gap": 2}, "buffer_timeout": 0.05}, "T1 T5 M3 !TIMEOUT:3"),
        ({"policy": {"max_gap": 2}}, "T2:map>odom T5:map>odom T4:odom>lidar M0 = T5:odom>lidar =0"),
        # Only the latest transform has an age, which is that of the moment when the message passes.
        ({"policy": {"max_age": 0.5}}, "C100 T99 M99 =99 M0 = T99.5 =0 C100.1 M0 = C100 M0 =0 T100 =0"),
        ({"policy": {"max_age": 1}, "buffer_timeout": 0.05}, "C100 T9 M0 !TIMEOUT:0"),
        ({"policy": {"max_age": 1}, "frames": "map mirror"}, "C9 T9 M0 T9:lidar>mirror =0"),
        ({"policy": {"max_age": 1}, "frames": "map mirror"}, "C5 T5 M0 C9 T9:lidar>mirror = T9 =0"),
        ({"policy": {"max_age": {"ladar": 1}}}, "C1 M0 M1 T1 !NO_TRANSFORM_FOUND:0 =1"),
    ],
    ids=str,
)
def test_script(make, options, script):
    make(**options).run(script)


SECONDS = st.integers(0, 14) | st.integers(0, 40)  # the buffer keeps 10
FRAMES = ["map", "odom", "lidar", "camera"]
WORDS = st.one_of(
    st.builds("M{}@{}".format, SECONDS, st.sampled_from(["lidar", "camera", "", "//bad"])),
    st.builds(
        "T{}:{}>{}".format,
        st.lists(SECONDS, min_size=1, max_size=4).map(lambda seconds: ",".join(map(str, seconds))),
        *[st.sampled_from(FRAMES)] * 2,
    ),
    st.sampled_from(["forget", "clear"]),
)


class OneByOne:
    """
    What becomes of the messages that wait in a filter, as in tf2: after each insert, each transform that a
    message needs is tried.
    """

    def __init__(self, buffer, frames, tolerance, policy):
        self.buffer, self.frames, self.tolerance = buffer, frames.split(), Duration(seconds=tolerance)
        self.policy = policy
        self.lacking = {}  # by the id of a message: what it lacks
        self.may_end = set()  # ids of those that lack data which the buffer has refused

    def add(self, message):
        stamp = Time.from_msg(message.header.stamp)
        stamps = [stamp, stamp + self.tolerance] if stamp.nanoseconds else [stamp]
        self.lacking[id(message)] = [
            (frame, message.header.frame_id, one) for frame in self.frames for one in stamps
        ]
        return self.passed()

    def insert(self, link):
        self.buffer.set_transform(link, "me")
        return self.passed()

    def passed(self):
        """The ids of the messages that pass now."""
        histories = self.buffer.histories().values()
        horizons = [int(one.stamps_ns[-1]) - 10 * S for one in histories]
        for key, lacking in self.lacking.items():
            lacking[:] = [query for query in lacking if not self.buffer.can_transform(*query, **self.policy)]
            if any(0 < stamp.nanoseconds < ns for *_, stamp in lacking for ns in horizons):
                self.may_end.add(key)
        passed = {key for key, lacking in self.lacking.items() if not lacking}
        for key in passed:
            del self.lacking[key]
        return passed


@given(
    st.sampled_from(["map", "odom", "map odom"]),
    st.sampled_from([0.0, 2.0]),
    st.sampled_from([0, 1, 3]),
    st.sampled_from([{}, {}, {"tolerance": 2.5}, {"max_gap": 4}, {"tolerance": 1, "max_gap": 2}]),
    st.lists(WORDS, max_size=60),
)
def test_in_any_script_each_message_has_one_outcome_as_soon_as_it_can(
    tf2_ros, node, frames, tolerance, size, policy, words
):
    script = Script(tf2_ros, node, None, frames, size, tolerance=Duration(seconds=tolerance), policy=policy)
    one_by_one = OneByOne(tf2_ros.Buffer(Duration(seconds=10)), frames, tolerance, policy)
    kept = []  # so that ids are unique
    for word in words:
        passes = set()
        if word[0] == "M":
            message = point(word[1:])
            kept.append(message)
            passes = one_by_one.add(message)
            script.filter.add(message)
        else:
            script.step(word)
        if word[0] == "T":
            for link in links(word):
                passes |= one_by_one.insert(link)
        if word == "forget":
            one_by_one.buffer.clear()
        if word == "clear":
            one_by_one.lacking.clear()
        passed, dropped = list(map(id, taken(script.passed))), taken(script.dropped)
        assert sorted(passed) == sorted(passes), "each passes once, when it can"
        for reason, message in dropped:
            del one_by_one.lacking[id(message)]
            assert reason != "OUT_THE_BACK" or id(message) in one_by_one.may_end
            assert reason != "QUEUE_FULL" or size
        counts = script.filter.statistics()
        assert counts["waiting"] == len(one_by_one.lacking) and adds_up(counts)
        assert not size or counts["waiting"] <= size
        script.buffer._self_check()
    script.filter.close()
    assert script.buffer.statistics()["waiters"] == 0


def test_threads_that_add_and_insert_lose_nothing(tf2_ros, node, buffer):
    passed, count = Counter(), 2000
    filter = tf2_ros.MessageFilter(None, buffer, ["map", "odom"], 0, node=node)
    filter.registerCallback(lambda message: passed.update([id(message)]))
    messages = [[point(f"1.{i:06}") for i in range(count)] for _ in range(2)]

    def add(mine):
        for message in mine:
            filter.add(message)

    def insert_all():
        for i in range(count):
            buffer.set_transform(transform("map", "lidar", ns=S + 1000 * i), "me")
            buffer.set_transform(transform("odom", "map", ns=S + 1000 * i), "me")

    at_once(*(partial(add, mine) for mine in messages), insert_all)
    filter.close()
    assert passed == Counter(id(message) for mine in messages for message in mine)
    assert filter.statistics()["passed"] == 2 * count
    assert buffer.statistics()["waiters"] == 0


class TestArguments:
    @pytest.mark.parametrize(
        ("wrong", "error"),
        [
            ({"frames": ["map", 5]}, TypeError),
            ({"frames": []}, ValueError),
            ({"frames": ""}, ValueError),
            ({"frames": ["map", "/"]}, ValueError),
            ({"frames": ["map", "//odom"]}, ValueError),
            ({"queue_size": -1}, ValueError),
            ({"tolerance": Duration(seconds=-1)}, ValueError),
            ({"tolerance": Infinite}, ValueError),
            ({"tolerance": Duration(nanoseconds=2**62)}, ValueError),
            ({"input": "points"}, TypeError),
            ({"input": 5}, TypeError),
            ({"input": (PointStamped, "points")}, TypeError),
            ({"input": (Header, "headers", 10)}, TypeError),
            ({"buffer": 5}, TypeError),
        ],
        ids=str,
    )
    def test_it_is_refused_and_named(self, tf2_ros, node, wrong, error):
        [name] = wrong
        full = {"frames": "target", "input": "input|header"}.get(name, name)
        whole = {"input": None, "buffer": tf2_ros.Buffer(), "frames": "map", "queue_size": 0, **wrong}
        others = {"tolerance": whole.pop("tolerance", None)}
        with pytest.raises(error, match=full):
            tf2_ros.MessageFilter(*whole.values(), node=node, **others)

    @pytest.mark.parametrize(
        ("policy", "error", "text"),
        [
            ({"maxage": 1}, TypeError, "'maxage'. Did you mean 'max_age'"),
            ({"timeout": 1}, TypeError, "has no timeout; pass buffer_timeout"),
            ({"extrapolate": True}, TypeError, "extrapolate needs a tolerance"),
            ({"tolerance": "1"}, TypeError, "tolerance: expected a duration"),
            ({"max_gap": -1}, ValueError, r"max_gap must not be negative, got -1\.0"),
            ({"max_age": {"odom": float("nan")}}, ValueError, r"max_age\['odom'\]: expected .* NaN"),
            (0.5, TypeError, "policy: expected a LookupPolicy, which is a dict, got float"),
        ],
        ids=str,
    )
    def test_a_policy_that_no_lookup_accepts_is_refused(self, make, policy, error, text):
        with pytest.raises(error, match=text):
            make(policy=policy)

    def test_messages_without_header_are_refused_and_not_counted(self, make, tf2_ros):
        filter = make().filter
        wrong = None, SimpleNamespace(frame_id="a", stamp=None), SimpleNamespace(frame_id=7, stamp=3)
        for message in (tf2_ros.Header(), *(SimpleNamespace(header=one) for one in wrong)):
            with pytest.raises(TypeError):
                filter.add(message)
        assert filter.statistics()["received"] == 0


def test_one_warning_that_nearly_all_were_dropped(make, capfd):
    script = make(queue_size=1, frames="map\x1b[31m")
    make().run("T1" + " M1 M1@ =1 !EMPTY_FRAME_ID:1@" * 50)  # of which one half was
    for i in range(100):
        script.filter.add(point(f"{i + 1}@lidar\nFrame"))
    (warning,) = [line for line in capfd.readouterr().err.splitlines() if "MessageFilter" in line]
    assert r"MessageFilter [target=map\x1b[31m]" in warning
    told = ("the last 20 messages were dropped", "QUEUE_FULL", "does not exist", r"[lidar\nFrame]")
    assert all(part in warning for part in told)


@pytest.mark.parametrize("options", [{"frames": "map odom"}, {"tolerance": Duration(seconds=1)}])
def test_one_warning_where_a_message_needs_several_transforms(make, capfd, options):
    script = make(**options)
    script.run("T100:map>odom T100:odom>lidar" + " M1 !OUT_THE_BACK:1" * 20)
    (warning,) = [line for line in capfd.readouterr().err.splitlines() if "MessageFilter" in line]
    assert "the last 20 messages were dropped" in warning
    assert "Lookup would require extrapolation" in warning


def test_one_warning_names_the_limit_that_could_never_apply(make, capfd):
    make(policy={"tolerance": {"ladar": 1}}).run("T1" + " M1 !NO_TRANSFORM_FOUND:1" * 20)
    (warning,) = [line for line in capfd.readouterr().err.splitlines() if "MessageFilter" in line]
    assert "tolerance has a limit for [ladar], which does not exist. Did you mean [lidar]?" in warning


def test_a_clock_that_is_set_back_lets_a_message_pass(make, executor):
    script = make(policy={"max_age": 1})
    script.run("C200 T100 M0 = C100")
    until(lambda: script.passed, executor)
    script.run("=0")


def test_a_clock_that_raises_drops_what_waits_and_fails_no_insert(make):
    script = make(policy={"max_age": 1})
    script.run("C9 M0")
    script.buffer.clock = SimpleNamespace(now=lambda: 1 / 0)
    script.run("T9 !NO_TRANSFORM_FOUND:0")


class Subscriber:
    """The shape of a subscriber of message_filters, which is not on PyPI."""

    def registerCallback(self, callback):
        self.signalMessage = callback


class TestInput:
    def test_a_topic(self, make, node, executor):
        script = make(input=(PointStamped, "points", 10))
        publisher = node.create_publisher(PointStamped, "points", 10)
        until(lambda: publisher.get_subscription_count() == 1)
        publisher.publish(point())
        until(lambda: script.filter.statistics()["waiting"], executor)
        script.run("T1 =1")
        script.filter.close()
        until(lambda: publisher.get_subscription_count() == 0, executor)

    def test_one_warning_says_that_nobody_spins_the_node(self, make, node, new_node, monkeypatch, capfd):
        monkeypatch.setattr(call_queue, "WARN_S", 0.5)
        script = make(input=(PointStamped, "points", 10))
        publisher = new_node("publishing").create_publisher(PointStamped, "points", 10)
        until(lambda: publisher.get_subscription_count() == 1)
        publisher.publish(point())
        said = "MessageFilter [target=map] has taken no message of /"
        until(lambda: said in errors_so_far())
        script.filter._tf2_check()
        [warning] = [line for line in capfd.readouterr().err.splitlines() if said in line]
        assert warning.endswith("Spin it in a thread, for example with rclpy.spin(node).")

    def test_no_warning_while_the_node_is_spun_or_nothing_is_published(
        self, make, node, new_node, executor, monkeypatch, capfd
    ):
        monkeypatch.setattr(call_queue, "WARN_S", 0.0)
        script = make(input=(PointStamped, "points", 10))
        script.filter._tf2_check()  # no publisher
        publisher = new_node("publishing").create_publisher(PointStamped, "points", 10)
        until(lambda: node.count_publishers("points") and publisher.get_subscription_count() == 1)
        script.filter._tf2_check()  # the fixture's executor has the node
        assert "has taken no message" not in errors_so_far()
        executor.remove_node(node)
        script.filter._tf2_check()
        assert "has taken no message" in errors_so_far()

    def test_a_check_while_the_node_ends_is_silent(self, make, new_node, monkeypatch):
        script = make(input=(PointStamped, "points", 10))
        node = script.filter._node
        # It ends after the check has asked for that.
        monkeypatch.setattr(
            node, "count_publishers", lambda topic: node.destroy_node() or node.handle.__enter__()
        )
        script.filter._tf2_check()

    def test_a_filter(self, make):
        subscriber = Subscriber()
        script = make(input=subscriber)
        subscriber.signalMessage(point(), "more")
        script.run("T1 =1")
        script.filter.close()
        subscriber.signalMessage(point())
        script.run("=")

    def test_a_message_filter(self, make):
        first = make()
        second = make(input=first.filter, frames="odom")
        first.run("M1 T1 =1")
        second.run("= T1 = T1:odom>map =1")


class TestCallbacks:
    """When they run, and what happens if they raise."""

    def test_what_a_listener_receives_passes_in_the_executor_of_the_filters_node(
        self, tf2_ros, make, executor, peer
    ):
        script, sender, names = make(queue_size=100), peer(), []
        script.filter.registerCallback(lambda _: names.append(threading.current_thread().name))
        listener = tf2_ros.TransformListener(script.buffer)  # whose node another executor spins
        for i in range(100):
            script.filter.add(point(f"1.{i:09}"))
        sender.send(("map", "lidar", S, 1), ("map", "lidar", 2 * S, 1))
        until(lambda: script.buffer.can_transform("map", "lidar", at(2)))
        until(lambda: script.buffer.statistics()["waiters"] == 0)
        assert script.passed == [] and script.filter.statistics()["waiting"] == 100
        script.filter.add(point("9"))  # one whose transform has arrived passes instead of being dropped
        assert names == ["MainThread"]
        with spinning(executor):
            until(lambda: len(names) == 100)
        assert "MainThread" not in names[1:]
        assert [m.header.stamp.nanosec for m in taken(script.passed)] == list(range(100))
        script.filter.clear()
        listener.unregister()

    def test_of_what_a_listener_receives_at_once_each_insert_counts(
        self, tf2_ros, make, executor, peer, node
    ):
        script, sender, found = make(), peer(), []
        listener = tf2_ros.TransformListener(script.buffer, node)
        script.filter.registerFailureCallback(lambda *given: found.append(given[2]), with_text=True)
        script.run("T1 M11")
        future = script.buffer.wait_for_transform_async("map", "lidar", at(11))
        messages = [transform("map", "lidar", seconds) for seconds in (12, 40, 41)]
        sender.send_bytes(encode(messages))
        until(lambda: script.passed, executor)
        assert future.done() and not script.buffer.can_transform("map", "lidar", at(11))
        script.run("=11 M35")
        sender.send_bytes(encode([transform("map", "lidar", 60)]))
        until(lambda: script.dropped, executor)
        script.run("!OUT_THE_BACK:35")
        assert re.search(r"past\.  Requested time 35", found[0])
        listener.unregister()

    def test_what_a_listener_receives_passes_under_the_policy(self, tf2_ros, make, executor, peer, node):
        script, sender = make(policy={"tolerance": {"odom": 1}, "max_age": 1000}), peer()
        listener = tf2_ros.TransformListener(script.buffer, node)
        script.run("M1.5 M0")
        sender.send(("map", "odom", S, 1), ("odom", "lidar", S, 1), ("odom", "lidar", 2 * S, 1))
        until(lambda: script.passed, executor)
        script.run("=1.5")
        now_ns = node.get_clock().now().nanoseconds
        sender.send(("map", "odom", now_ns, 1), ("odom", "lidar", now_ns, 1))
        until(lambda: script.passed, executor)
        script.run("=0")
        listener.unregister()

    @pytest.mark.parametrize("how", ["clear", "destroy_node"])
    def test_what_is_received_does_not_pass_after(self, tf2_ros, make, node, peer, executor, how):
        script, sender = make(), peer()
        listener = tf2_ros.TransformListener(script.buffer)
        script.filter.add(point())
        sender.send(("map", "lidar", S, 1))
        until(lambda: call_queue_of(node).calls)
        script.filter.clear() if how == "clear" else node.destroy_node()
        until(lambda: script.filter.statistics()["cleared"] == 1)
        executor.spin_once(0.1)
        script.run("= M1 =1")  # inside `add`
        listener.unregister()

    def test_arguments_are_handed_on_and_one_can_be_taken_out(self, make):
        script, seen = make(), []
        script.filter.registerCallback(lambda *arguments: seen.append(arguments[1:]), 1, "two")
        script.filter.registerFailureCallback(lambda *arguments: seen.append(arguments[2:]), 3)
        taken_out = script.filter.registerCallback(seen.append)
        script.filter.callbacks.pop(taken_out)
        script.run("T1 M1 M1@ =1 !EMPTY_FRAME_ID:1@")
        assert seen == [(1, "two"), (3,)]

    @pytest.mark.parametrize(
        ("options", "script", "text"),
        [
            ({}, "M1@", 'Invalid argument "" .* source_frame - in tf2 frame_ids cannot be empty'),
            (
                {"buffer_timeout": 0.01},
                "T1 M1@lidr",
                r'Waited 0\.01 s for the transform: "lidr" .* does not exist\. Did you mean \[lidar\]\?',
            ),
            (
                {"buffer_timeout": 0},
                "T1 M3",
                r"Lookup would require extrapolation at time 3\.0*.* the only sample of lidar \(parent map\)",
            ),
            ({"frames": "map odom", "buffer_timeout": 0}, "T1 M1", '"odom" .* target_frame does not exist'),
            ({"buffer_timeout": 0, "tolerance": 1.0}, "T1 M1", r"time 2\.0*, but only time 1\.0* is in"),
            ({"buffer_timeout": 0, "policy": {"max_gap": 1}}, "T1 T5 M3", "apart than max_gap, 1"),
            ({"policy": {"tolerance": {"ladar": 1}}}, "M1 T1", r"\[ladar\], which does not .* \[lidar\]"),
            (
                {"queue_size": 2},
                "T1 M5 M6 M7",
                r"Another message has arrived while 2 messages waited: .* at time 5\.0*",
            ),
            (
                {},
                "T1:map>odom T30:odom>lidar T39:map>odom T38:odom>lidar M1",
                r"past\.  Requested time 1\.0*",
            ),
        ],
        ids=[
            *("empty name", "misspelt", "late", "two targets", "tolerance", "gap", "limit"),
            *("full queue", "too old"),
        ],
    )
    def test_a_text_says_what_a_dropped_message_lacked(self, make, options, script, text):
        one, seen = make(**options), []
        *before, last = script.split()
        for word in before:
            one.step(word)
        one.filter.registerFailureCallback(lambda *given: seen.append(given), 3, with_text=True)
        one.step(last)
        until(lambda: seen)
        ((message, reason, found, three),) = seen
        assert [(reason.name, message)] == one.dropped
        assert re.search(text, found), found
        assert three == 3

    def test_a_text_is_that_of_the_moment_of_the_drop(self, make, node, executor):
        script, seen = make(buffer_timeout=0.01), []
        script.filter.registerFailureCallback(lambda *given: seen.append(given[2]), with_text=True)
        script.step("M1@lidr")
        until(lambda: call_queue_of(node).calls)
        script.step("T1:map>lidr")
        until(lambda: bool(seen), executor)
        assert 'Waited 0.01 s for the transform: "map" passed to' in seen[0]
        assert "The buffer is empty" in seen[0]

    def test_what_ends_a_program_ends_the_insert_after_the_other_messages_have_passed(self, make):
        script, seen = make(), []
        script.filter.registerCallback(lambda message: seen.append(message) or sys.exit("mine"))
        script.filter.add(point())
        script.filter.add(point())
        with pytest.raises(SystemExit, match="mine"):
            insert(script.buffer)
        assert len(seen) == 2
        script.run("=1,1")

    def test_one_may_use_the_filter_and_the_buffer(self, make):
        script = make()

        def more(message):
            if message.header.stamp.sec < 5:
                insert(script.buffer, message.header.stamp.sec + 1)
                script.filter.add(point(f"{message.header.stamp.sec + 1}"))

        script.filter.registerCallback(more)
        script.run("T1 M1 =1,2,3,4,5")


class TestIterating:
    @pytest.fixture
    def filter(self, tf2_ros, node, buffer):
        with tf2_ros.MessageFilter(None, buffer, "map", 0, node=node) as filter:
            yield filter

    async def seconds(self, filter, count=9):
        """Take so many; their seconds, and where their transforms are."""
        seen = []
        async for message, found in filter:
            assert found.header.frame_id == "map"
            seen.append((message.header.stamp.sec, found.transform.translation.x))
            if len(seen) == count:
                break
        return seen

    def test_asyncio_without_an_executor_whoever_inserts(self, tf2_ros, filter, buffer, peer):
        """Nobody spins the node: an iteration is no callback."""
        listener, sender = tf2_ros.TransformListener(buffer), peer()

        async def main():
            task = asyncio.ensure_future(self.seconds(filter, 3))
            await asyncio.sleep(0)
            for second in "123":
                filter.add(point(second))
            insert(buffer, 1, x=1)
            await asyncio.to_thread(sender.send, ("map", "lidar", 2 * S, 2), ("map", "lidar", 3 * S, 3))
            return await task

        assert asyncio.run(asyncio.wait_for(main(), DEADLINE_S)) == [(1, 1.0), (2, 2.0), (3, 3.0)]
        listener.unregister()

    def test_several_iterations_get_all_until_the_filter_is_closed(self, filter, buffer):
        iterations = [filter.__aiter__(), filter.__aiter__()]
        insert(buffer)
        filter.add(point("1"))
        filter.add(point("2"))
        filter.close()
        for iteration in iterations:
            assert asyncio.run(self.seconds(iteration)) == [(1, 0.0)]
        assert asyncio.run(self.seconds(filter)) == []

    @pytest.mark.parametrize("waits", [False, True])
    def test_the_transform_is_into_the_first_frame_at_the_stamp(self, tf2_ros, node, buffer, waits):
        frames = ["map", "odom"]
        with tf2_ros.MessageFilter(None, buffer, frames, 0, node=node, tolerance=1) as filter:
            iteration = filter.__aiter__()
            if waits:
                filter.add(point("1"))
            for second in (1, 2):
                insert(buffer, second, "odom", "lidar", x=second)
                insert(buffer, second, "map", "odom", x=10)
            if not waits:
                filter.add(point("1"))
        assert asyncio.run(self.seconds(iteration)) == [(1, 11.0)]

    def test_a_cancelled_step_loses_nothing(self, filter):
        async def main():
            iteration = filter.__aiter__()
            for _ in range(3):
                with pytest.raises(asyncio.TimeoutError):
                    await asyncio.wait_for(iteration.__anext__(), 0.01)
            filter.add(point("1@map"))
            return await asyncio.wait_for(iteration.__anext__(), DEADLINE_S)

        assert asyncio.run(main())[0].header.stamp.sec == 1

    def test_a_cancelled_step_of_two_leaves_the_other_waiting(self, filter):
        async def main():
            iteration = filter.__aiter__()
            steps = [asyncio.ensure_future(iteration.__anext__()) for _ in range(2)]
            await asyncio.sleep(0)
            steps[0].cancel()
            await asyncio.sleep(0)
            filter.add(point("1@map"))
            return await asyncio.wait_for(steps[1], DEADLINE_S)

        assert asyncio.run(main())[0].header.stamp.sec == 1

    def test_threads_that_share_an_iteration_get_each_message_once_and_all_end(self, filter):
        iteration, count = filter.__aiter__(), 2000
        got = [[] for _ in range(4)]

        async def take(own):
            async for message, _ in iteration:
                own.append(message.header.stamp.nanosec)

        def add_all():
            for i in range(count):
                filter.add(point(f"1.{i:09}@map"))
            filter.close()

        at_once(add_all, *(partial(asyncio.run, take(own)) for own in got))
        assert sorted(sum(got, [])) == list(range(count))

    @pytest.mark.parametrize("how", ["shutdown", "destroy_node"])
    def test_a_shutdown_ends_it_and_those_that_begin_later(self, filter, ros, node, how):
        async def main():
            taking = [asyncio.ensure_future(self.seconds(filter)) for _ in range(2)]
            await asyncio.sleep(0)
            getattr(ros if how == "shutdown" else node, how)()
            taking.append(self.seconds(filter))
            return await asyncio.wait_for(asyncio.gather(*taking), DEADLINE_S)

        assert asyncio.run(main()) == [[], [], []]

    def test_its_node_ends_it_in_the_executor_of_another_node(self, tf2_ros, buffer, new_node, executor):
        node = new_node("filtering")
        filter = tf2_ros.MessageFilter(None, buffer, "map", 0, node=node)
        task = executor.create_task(self.seconds(filter))
        executor.spin_once(timeout_sec=0)
        node.destroy_node()
        executor.spin_until_future_complete(task, timeout_sec=DEADLINE_S)
        assert task.result() == []


class TestEnd:
    def test_a_with_block_closes_it_also_after_an_error(self, tf2_ros, node):
        before = len(list(node.subscriptions))
        topic = (PointStamped, "points", 10)
        with pytest.raises(ZeroDivisionError):
            with tf2_ros.MessageFilter(topic, tf2_ros.Buffer(), "map", 0, node=node) as filter:
                assert len(list(node.subscriptions)) == before + 1
                filter.add(point())
                raise ZeroDivisionError
        assert len(list(node.subscriptions)) == before
        name = "tf2_ros.MessageFilter: into map"
        assert repr(filter) == f"<{name}: 1 received, 0 waiting, 0 passed, 0 dropped, closed>"
        assert filter.statistics()["cleared"] == 1

    def test_one_that_is_dropped_leaves_no_waiter(self, tf2_ros, node, buffer):
        filter = tf2_ros.MessageFilter(None, buffer, ["map", "odom"], 0, node=node, buffer_timeout=1000.0)
        filter.add(point())
        assert buffer.statistics()["waiters"] == 2
        del filter
        gc.collect()
        assert buffer.statistics()["waiters"] == 0

    def test_at_the_timeout_it_has_the_answer_of_an_insert_that_is_under_way(self, tf2_ros, make):
        class Due:
            """A message whose transform was inserted, but not tried for this one before `lack` is called."""

            answer = None

            def outcome(self):
                return self.answer

            def lack(self):
                self.answer = "an answer"
                return ""

        outcome = make().filter._outcome(Due(), tf2_ros.FilterFailureReason.TIMEOUT)
        assert outcome == ("an answer", None)

    def test_the_repr_shows_frames_and_counts(self, make):
        script = make(frames="map odom\x1b", queue_size=1)
        script.run("M1 M2 !QUEUE_FULL:1")
        name = "tf2_ros.MessageFilter: into map and odom\\x1b"
        assert repr(script.filter) == f"<{name}: 2 received, 1 waiting, 0 passed, 1 dropped>"
