# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A feed that a program fills: from a pipe, a thread, or a wire of the test."""

import logging
import os
import struct
import subprocess
import sys
import threading
import time
import tracemalloc

import numpy as np
import pytest
from feed_helpers import Wire, message, seen
from times_and_transforms import S, translation
from waiting import DEADLINE_S, until

from tf2_ros import Buffer, TransformException
from tf2_ros.records import Recording
from tf2_ros_tools.diagnosis.findings import Limits
from tf2_ros_tools.listening.session import Listening
from tf2_ros_tools.live import Feed, Heard, Publisher
from tf2_ros_tools.live.feed_session import FeedSession

PIPE = """
import struct, sys
from feed_helpers import message
for n in range(100):
    data = message(x=n, seconds=1 + n)
    sys.stdout.buffer.write(struct.pack("<I", len(data)) + data)
"""


def test_a_feed_of_a_pipe():
    def read(stream):
        while header := stream.read(4):
            feed.take(stream.read(*struct.unpack("<I", header)), False, "the pipe")
        feed.close("the pipe has ended")

    here = os.path.dirname(__file__)
    path = os.pathsep.join([here, os.environ["PYTHONPATH"]])
    writing = subprocess.Popen(
        [sys.executable, "-c", PIPE], stdout=subprocess.PIPE, env=os.environ | {"PYTHONPATH": path}
    )
    with Feed() as feed, writing:
        threading.Thread(target=read, args=(writing.stdout,)).start()
        got = feed.buffer.lookup_transform("map", "base", 100 * S, timeout=DEADLINE_S)
        assert translation(got)[0] == 99
        assert "broadcaster: 'the pipe'" in feed.buffer.all_frames_as_yaml()
        with pytest.raises(ConnectionError, match="^the feed has ended .the pipe has ended.$"):
            feed.wait_until_heard(DEADLINE_S)
    assert feed.topics["/tf"].count == 100


def test_counts_losses_and_arrivals_by_topic():
    feed = Feed(topics=("/a", "/b"))
    assert feed.topics == {"/a": Heard(0, 0, 0, None), "/b": Heard(0, 0, 0, None)}
    feed.take(message(), False, lost=3)
    feed.take(memoryview(message()), False, lost=2)
    feed.take(message("base", "camera"), True)
    heard = feed.topics
    assert [(one.count, one.lost, one.malformed) for one in heard.values()] == [(2, 5, 0), (1, 0, 0)]
    assert all(0 <= one.last < DEADLINE_S for one in heard.values())
    assert feed.buffer.frames()["camera"].static and not feed.buffer.frames()["base"].static


def test_rates_are_of_the_times_at_which_messages_were_sent():
    """Several may arrive at once, or long after the feed was made."""
    feed = Feed()
    feed.take(message("base", "camera"), True, sent_ns=5 * S)
    for i in (1, 0, *range(2, 11)):
        feed.take(message(), False, sent_ns=100 * S + i * S // 50)
    assert feed.topics["/tf"].rate == pytest.approx(50)
    assert feed.topics["/tf_static"].rate is None


def test_a_rate_is_of_what_was_sent_since_the_clock_of_the_robot_was_set():
    feed = Feed()
    began_ns = time.time_ns()
    for first_ns in (30 * S, began_ns, began_ns - 3600 * S):
        for i in range(101):
            feed.take(message(), False, sent_ns=first_ns + i * S // 50)
        assert feed.topics["/tf"].rate == pytest.approx(50)
    feed.take(message(), False, sent_ns=40 * S)
    assert feed.topics["/tf"].rate is None


def test_rates_are_of_the_times_of_reception_if_it_is_not_known_when_messages_were_sent():
    feed = Feed()
    began_s = time.time()
    for _ in range(11):
        feed.take(message(), False)
    lasted_s = time.time() - began_s
    assert feed.topics["/tf"].rate >= 10 / lasted_s


def test_it_fills_a_given_buffer_and_prefixes_frames():
    buffer = Buffer()
    one, other = Feed(buffer, prefix="a/"), Feed(buffer, prefix="b/")
    one.take(message(), False)
    other.take(message(x=2.0), True)
    assert one.buffer is buffer
    assert sorted(buffer.frames()) == ["a/base", "a/map", "b/base", "b/map"]
    with pytest.raises(TypeError, match="prefix"):
        Feed(prefix=1)


MALFORMED = {
    "nothing": b"",
    "a part of the header": b"\0",
    "only the header": b"\0\1\0\0",
    "cut off": message()[:-1],
    "another encoding": b"\0\7" + message()[2:],
    "too long": message() + message(),
}


def test_names_of_publishers_are_escaped_in_texts(caplog):
    feed = Feed(wire=Wire(reasons={"/tf": "/a\x1b publishes it as B"}))
    feed.take(b"", True, "/a\nb")
    assert r"/tf_static from /a\nb: " in caplog.text
    assert r"/a\x1b publishes" in feed.why_silent(1.0)


@pytest.mark.parametrize("data", MALFORMED.values(), ids=MALFORMED.keys())
def test_a_malformed_message_is_counted_and_the_first_of_a_topic_logged(caplog, data):
    feed = Feed()
    for is_static in (False, False, True):
        feed.take(data, is_static, "/robot")
    feed.take(message(), False)
    assert [(one.count, one.malformed) for one in feed.topics.values()] == [(1, 2), (0, 1)]
    texts = [one.getMessage() for one in caplog.records]
    assert [text.partition(": ")[0] for text in texts] == [
        "Ignoring a malformed message on /tf from /robot",
        "Ignoring a malformed message on /tf_static from /robot",
    ]
    assert all("malformed TFMessage: " in text for text in texts)
    assert seen(feed) == 1
    with pytest.raises(TimeoutError, match="nothing on /tf_static in 0.01 s: 1 message could not be read$"):
        feed.wait_until_heard(0.01)


def test_what_is_not_a_message_is_refused():
    feed = Feed()
    for data in (None, "text", 5, [1]):
        with pytest.raises(TypeError):
            feed.take(data, False)
    assert feed.topics["/tf"] == Heard(0, 0, 0, None)


@pytest.mark.parametrize(
    ("arguments", "error", "text"),
    [
        ({"is_static": "false"}, TypeError, "^is_static: expected a bool, got str$"),
        ({"publisher": 5}, TypeError, r"\(expected str, got int\)$"),
        ({"publisher": "a\0b"}, ValueError, "must not contain a NUL character"),
        ({"sent_ns": float("nan")}, TypeError, "^'float' object cannot be interpreted as an integer$"),
        ({"lost": "1"}, TypeError, "^'str' object cannot be interpreted as an integer$"),
    ],
)
def test_invalid_arguments_of_take_are_refused_and_nothing_is_inserted(arguments, error, text):
    feed = Feed()
    with pytest.raises(error, match=text):
        feed.take(**{"data": message(), "is_static": False} | arguments)
    assert feed.topics["/tf"] == Heard(0, 0, 0, None) and feed.buffer.frames() == {}


def test_views_of_bytes_in_any_layout_are_read():
    feed, data = Feed(), message()
    spread = bytes(byte for one in data for byte in (one, 0))
    views = [
        memoryview(spread)[::2],
        memoryview(data[::-1])[::-1],
        memoryview(data).cast("B", (2, len(data) // 2)),
    ]
    for view in views:
        feed.take(view, False, sent_ns=np.int64(5))
    assert feed.topics["/tf"].count == len(views) and seen(feed) == 1
    views[0].release()
    with pytest.raises(ValueError, match="released memoryview"):
        feed.take(views[0], False)
    assert feed.topics["/tf"].malformed == 0


@pytest.mark.parametrize("what", ["name", "prefix"])
def test_names_and_prefixes_of_feeds(what):
    with pytest.raises(TypeError, match=f"^{what}: expected a str, got int$"):
        Feed(**{what: 1})
    with pytest.raises(ValueError, match="must not contain a NUL character"):
        Feed(**{what: "a\0b"})


def test_a_feed_keeps_nothing_for_each_publisher():
    def take(publishers):
        for n in publishers:
            feed.take(data, n % 2 == 0, f"/node{n}", sent_ns=S + n)

    feed, data = Feed(), message()
    take(range(100))
    tracemalloc.start()
    try:
        take(range(100, 10_100))
        kept_bytes, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept_bytes < 100_000


def test_waiting_until_heard():
    with Feed() as feed:
        feed.take(message(), False)
        thread = threading.Thread(target=lambda: feed.take(message("base", "camera"), True))
        thread.start()
        feed.wait_until_heard(DEADLINE_S)
        thread.join()
        feed.wait_until_heard(0)


def test_a_wait_says_which_topic_is_silent_and_why():
    wire = Wire(reasons={"/tf": "the domain is wrong", "/tf_static": "no node publishes it"})
    with Feed(name="x://robot", wire=wire) as feed:
        with pytest.raises(TimeoutError) as raised:
            feed.wait_until_heard(0.01)
        assert str(raised.value) == (
            "nothing has been received on /tf or /tf_static in 0.01 s: the domain is wrong; "
            "no node publishes it"
        )
        wire.reasons["/tf_static"] = "the domain is wrong"
        with pytest.raises(TimeoutError, match=" in 0.01 s: the domain is wrong$"):
            feed.wait_until_heard(0.01)
        wire.take(message(), False)
        wire.reasons.clear()
        with pytest.raises(TimeoutError) as raised:
            feed.wait_until_heard(0.01)
        assert str(raised.value) == "/tf is received (1 message), but nothing on /tf_static in 0.01 s"
        assert feed.publishers() == [Publisher("/tf", "/robot", "")]


def test_errors_of_lookups_say_what_has_not_been_received(monkeypatch):
    wire = Wire(reasons={"/tf": "the domain is wrong", "/tf_static": "no node publishes it"})
    with Feed(name="x://robot", wire=wire) as feed:

        def error():
            with pytest.raises(TransformException) as raised:
                feed.buffer.lookup_transform("map", "camera", 0)
            return str(raised.value).lower()

        # The buffer asks once in a while.
        both = "nothing has been received on /tf or on /tf_static: the domain is wrong; no node publishes it"
        until(lambda: both in error())
        wire.take(message("map", "base"), False)
        until(lambda: "nothing has been received on /tf_static: no node publishes it" in error())
        monkeypatch.setattr("tf2_ros_tools.live.feed.SILENT_S", 0.0)
        until(lambda: "nothing has been received on /tf_static or on /tf for " in error())
        wire.take(message("base", "x"), True)
        until(lambda: "nothing has been received on /tf for " in error())
        monkeypatch.undo()
        until(lambda: "nothing has been received" not in error())


def test_a_publisher_whose_name_becomes_known_is_one_stream():
    recording, wire = Recording(), Wire()
    wire.publishers = lambda: [Publisher("/tf", "/robot", "", "0123")]
    with Feed(name="x://robot", wire=wire, recording=recording) as feed:
        wire.take(message(), False, "0123", gid=b"\x01\x23")
        wire.take(message(seconds=2), False, "/robot", gid=b"\x01\x23")
        heard = Listening(FeedSession(feed, "x://robot"), recording, None)
        streams = heard.report(Limits()).streams
    assert [(one.frame, one.publisher) for one in streams] == [("base", "/robot")]


def test_static_transforms_of_a_publisher_that_has_exited_are_no_problem():
    recording, wire = Recording(), Wire()
    wire.publishers = lambda: [Publisher("/tf_static", "/present", "", "02")]
    with Feed(name="x://robot", wire=wire, recording=recording) as feed:
        wire.take(message(x=1.0), True, "/ended", gid=b"\x01")
        wire.take(message(x=2.0), True, "/present", gid=b"\x02")
        heard = Listening(FeedSession(feed, "x://robot"), recording, None)
        assert heard.report(Limits()).findings == []
        # Some publishers have no gid.
        wire.take(message(x=3.0), True)
        kinds = {one.kind for one in heard.report(Limits()).findings}
    assert kinds == {"publishers", "values"}


def test_a_publisher_of_malformed_messages_is_not_called_silent():
    reasons = {"/tf": "no node publishes it", "/tf_static": "/fixed publishes it, but has sent nothing"}
    with Feed(wire=(wire := Wire(reasons=reasons))) as feed:
        for _ in range(2):
            wire.take(b"damaged", True)
        assert feed.why_silent(1.0).endswith(": 2 messages could not be read; no node publishes it")
        with pytest.raises(TransformException, match="on /tf_static: 2 messages [^;]*; no node publishes it"):
            feed.buffer.lookup_transform("map", "base", 0)


def test_a_silent_publisher_is_a_problem_of_qos_only_after_the_discovery(monkeypatch):
    wire = Wire(reasons={"/tf": "/robot publishes it, but has sent nothing"})
    with Feed(wire=wire) as feed:
        session = FeedSession(feed, "x://robot")
        [found] = session.findings()
        assert found.kind == "nothing"
        monkeypatch.setattr("tf2_ros_tools.live.feed_session.DISCOVERY_S", 0.0)
        [found] = session.findings()
    assert found.kind == "qos" and found.text.endswith(": /robot publishes it, but has sent nothing")


def test_the_lines_of_a_text_are_logged_as_lines(capsys):
    with Feed(wire=Wire()) as feed:
        FeedSession(feed, "x://robot").info("Waiting for a\x1b\nKnown frames: none")
    assert capsys.readouterr().err == "[INFO] Waiting for a\\x1b\nKnown frames: none\n"


def test_a_wire_ends_a_feed():
    with Feed(name="x://robot", wire=(wire := Wire())) as feed:
        wire.take(message(), False)
        threading.Thread(target=wire.end, args=("the robot has gone",)).start()
        with pytest.raises(ConnectionError, match="^x://robot has ended .the robot has gone.$"):
            feed.wait_until_heard(DEADLINE_S)
        wire.take(message(x=2.0), False)
        assert seen(feed) == 1 and wire.closed == 0
    assert wire.closed == 1
    with pytest.raises(ConnectionError, match="the robot has gone"):
        feed.broadcaster()


def test_the_end_of_a_feed_is_the_first_reason_for_its_silence():
    with Feed(name="x://robot", wire=(wire := Wire(reasons={"/tf": "the domain is wrong"}))) as feed:
        assert feed.why_ended() == ""
        wire.end("the robot has gone")
        why = "x://robot has ended (the robot has gone)"
        assert feed.why_silent(1.0) == feed.why_ended() == why
    with Feed() as feed:
        feed.take(message(), False)
        feed.take(message("base", "camera"), True)
        assert feed.why_silent(1.0) == ""
    assert feed.why_silent(1.0) == "the feed has ended (it was closed)"


def test_a_wire_that_does_not_open_is_closed():
    wire = Wire(refusal=ConnectionError("nothing answers"))
    with pytest.raises(ConnectionError, match="^nothing answers$"):
        Feed(wire=wire)
    assert wire.closed == 1


def test_what_goes_wrong_in_a_message_of_a_wire_is_logged(caplog):
    with Feed(name="x://robot", wire=(wire := Wire())) as feed:
        wire.take(None, False)
        wire.take(message(), False)
        assert seen(feed) == 1
    [record] = caplog.records
    assert record.getMessage() == "x://robot: a message could not be inserted" and record.exc_info


@pytest.mark.parametrize("_", range(20))
def test_closing_in_the_midst_of_messages(_):
    feed = Feed(wire=(wire := Wire()))
    data, ending = message(count=20), threading.Event()

    def take():
        while not ending.is_set():
            wire.take(data, False)

    taking = [threading.Thread(target=take) for _ in range(2)]
    closing = [threading.Thread(target=feed.close) for _ in range(2)]
    for thread in taking:
        thread.start()
    until(lambda: feed.topics["/tf"].count > 2)
    for thread in closing:
        thread.start()
    for thread in closing:
        thread.join()
    ending.set()
    for thread in taking:
        thread.join()
    assert seen(feed) == 1


def test_a_callback_of_a_message_closes_the_feed():
    feed = Feed(wire=(wire := Wire()))
    feed.buffer.on_change("map", "base", lambda transform: feed.close("enough"))
    wire.take(message(), False)
    wire.take(message(x=2.0, seconds=2.0), False)
    assert seen(feed) == 1 and wire.closed >= 1


def test_the_offset_of_clocks():
    feed = Feed()
    assert feed.clock_offset is None
    now_ns = time.time_ns()
    feed.take(message(), False, sent_ns=now_ns - 2 * S)
    feed.take(message(), False, sent_ns=now_ns - S)
    feed.take(message(), False, sent_ns=now_ns - 3 * S)
    # Latched, before this program began.
    feed.take(message(), True, sent_ns=now_ns - 100 * S)
    assert 1 <= feed.clock_offset < DEADLINE_S


def test_the_offset_of_clocks_is_that_of_the_last_minute(monkeypatch):
    monkeypatch.setattr("tf2_ros_tools.live.feed.PERIOD_NS", 1)  # a minute has 6 of them
    feed = Feed()
    feed.take(message(), False, sent_ns=time.time_ns())
    until(lambda: feed.clock_offset is None)


def test_a_clock_that_is_ahead_is_warned_of_once(caplog):
    feed = Feed(name="x://robot")
    feed.take(message(), False, sent_ns=time.time_ns() + 1000 * S)
    feed.take(message(), False, sent_ns=time.time_ns() + 2000 * S)
    [record] = caplog.records
    assert record.levelno == logging.WARNING
    text = record.getMessage()
    assert text.startswith("x://robot: the clock of the robot is 1000 s ahead of the clock of this machine")
    assert -1000 - DEADLINE_S < feed.clock_offset + 1000 < 0 and "max_age" in text


def test_messages_that_all_arrive_late_are_warned_of_once(monkeypatch, caplog):
    monkeypatch.setattr("tf2_ros_tools.live.feed.PERIOD_NS", 1)
    feed = Feed(name="x://robot")
    for _ in range(4):
        feed.take(message(), False, sent_ns=time.time_ns() - 1000 * S)
    [record] = caplog.records
    assert record.getMessage().startswith("x://robot: messages arrive 1000 s after the robot sent them")


def run_here(program):
    path = os.pathsep.join([os.path.dirname(__file__), os.environ["PYTHONPATH"]])
    command = [sys.executable, "-c", program]
    return subprocess.run(command, env=os.environ | {"PYTHONPATH": path}, timeout=5 * DEADLINE_S).returncode


FORKED = """
import os
from feed_helpers import Wire, message
from times_and_transforms import transform
from tf2_ros_tools.live import Feed

feed = Feed(name="x://robot", wire=Wire())
feed.take(message(), False)
senders = feed.broadcaster(), feed.static_broadcaster()
if (child := os.fork()) == 0:
    for call in (
        lambda: feed.take(message(), False),
        lambda: feed.wait_until_heard(1),
        lambda: feed.broadcaster(),
        lambda: feed.static_broadcaster(),
        lambda: feed.publishers(),
        lambda: feed.topics,
        lambda: feed.clock_offset,
        lambda: feed.why_silent(1),
        lambda: senders[0].sendTransform(transform("map", "base")),
        lambda: senders[1].sendTransform(transform("map", "base")),
    ):
        try:
            call()
        except RuntimeError as error:
            assert str(error).startswith("this feed belongs to the parent process"), error
        else:
            os._exit(1)
    assert feed.why_ended().startswith("this feed belongs to the parent process")
    try:
        feed.buffer.lookup_transform("map", "camera", 0)
    except Exception as error:
        assert "X://robot: this feed belongs to the parent process: create a new one" in str(error), error
    feed.close()
    os._exit(feed._wire.closed)
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
feed.take(message(), False)
"""


def test_a_forked_child_refuses_the_feed_of_its_parent():
    assert run_here(FORKED) == 0


FORKED_AT_ANY_TIME = """
import os, signal, threading
from feed_helpers import Wire, message
from times_and_transforms import transform
from tf2_ros_tools.live import Feed
from waiting import DEADLINE_S

feed = Feed(wire=Wire())
moving, fixed = feed.broadcaster(), feed.static_broadcaster()
calls = [
    lambda: feed.take(message(), False, sent_ns=1),
    lambda: moving.sendTransform(transform("map", "a")),
    lambda: fixed.sendTransform(transform("map", "b")),
    lambda: feed.buffer.lookup_transform("map", "nowhere", 0),
    lambda: feed.topics,
    lambda: feed.close(),
]

def fill(call):
    while True:
        call()

for call in calls[:3]:
    threading.Thread(target=fill, args=(call,), daemon=True).start()
for _ in range(15):
    if (child := os.fork()) == 0:
        signal.alarm(round(DEADLINE_S))  # ends a child that waits for a lock
        for call in calls:
            try:
                call()
            except Exception:
                pass
        os._exit(0)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if status:
        os._exit(1)
os._exit(0)
"""


def test_a_forked_child_waits_for_no_lock_of_its_parent():
    assert run_here(FORKED_AT_ANY_TIME) == 0
