# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What an inbox does with the messages of a source: here, of one that needs no middleware."""

import gc
import random
import resource
import signal
import threading
import time
import weakref
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from cdr_encoder import encode
from compiling_extensions import compiled
from forked_children import in_a_child
from random_runs import seeds
from rclpy.serialization import serialize_message
from rclpy.time import Time
from times_and_transforms import S, at, transform
from waiting import errors_so_far, until

from tf2_msgs.msg import TFMessage
from tf2_ros import Buffer
from tf2_ros._process.background import Background, add_owner
from tf2_ros._process.inbox import Inbox, Inboxes, Observer

LATEST = Time()
MANY = 5000  # transforms, of more bytes than are inserted under the lock of all inboxes


def serialized(*transforms):
    return bytes(serialize_message(TFMessage(transforms=transforms)))


@pytest.fixture
def source():
    return compiled("listed_source").ListedSource()


@pytest.fixture
def inboxes():
    """Those of a test, for which no thread of the process does anything."""
    inboxes = Inboxes()
    yield inboxes
    inboxes.stop()


@pytest.fixture
def inbox(source, buffer, inboxes):
    """Fills the buffer from the source."""
    inbox = Inbox(source, list, inboxes=inboxes)
    inbox.fill(buffer)
    yield inbox
    inbox.close()


@pytest.mark.parametrize("closes", [False, True])
def test_a_message_that_moves_a_long_history_is_inserted_as_others(closes, source, inbox):
    # Its memory is full, so that the first message moves it.
    buffer = Buffer(cache_time=1.0)
    buffer.set_transforms([transform("map", "robot", ns=100 + 2 * i) for i in range(MANY + 166)], "x")
    before = buffer.statistics()["bytes"]
    inbox.fill(buffer)
    for ns in (101, 50_000, 60_000):
        source.put(serialized(transform("map", "robot", ns=ns), transform("map", "person", ns=ns)))
    if closes:
        inbox.catch_up()
        inbox.close()
    assert buffer.statistics()["bytes"] > 1.3 * before
    assert buffer.frames()["robot"].count == MANY + 166 + 3
    assert buffer.frames()["person"].count == 3
    buffer._self_check()


def test_a_read_takes_from_every_inbox_although_one_ends_meanwhile(source, inbox, buffer, inboxes):
    slow, other = (compiled("listed_source").ListedSource() for _ in range(2))
    ending = Inbox(other, list, inboxes=Inboxes())  # another lock: it ends while the first one is read
    first = Inbox(slow, list, inboxes=inboxes)
    for one in (ending, first):
        one.fill(buffer)
    source.put(serialized(transform("map", "robot", 1)))
    slow.slow_down()
    slow.put(serialized(transform("map", "person", 1)))
    receiver = threading.Thread(target=inboxes.drain_when_due)
    receiver.start()
    until(slow.is_taking)
    reads = threading.Event()
    answers = []

    def read():
        reads.set()
        answers.append(buffer.can_transform("map", "robot", at(1)))

    reader = threading.Thread(target=read)
    reader.start()
    reads.wait()
    ending.close()
    assert slow.go_on()
    reader.join()
    inboxes.stop()
    receiver.join()
    assert answers == [True]
    first.close()


class Owner:
    """Of an inbox that the threads of the process serve."""

    kind = "listed source"

    def __init__(self, inbox):
        self.inbox, self.stop = inbox, inbox.close

    def _tf2_check(self):
        pass


def test_a_child_forked_during_the_insert_of_a_large_message_can_drop_the_buffer(source):
    owner = Owner(Inbox(source, list))
    buffer = Buffer()
    owner.inbox.fill(buffer)
    add_owner(owner)
    waiting = buffer.wait_for_transform_async("map", "last", at(1))
    held = [buffer, waiting]
    del buffer
    many = [transform("map", f"robot {number}", 1) for number in range(100_000)]
    source.put(serialized(*many, transform("map", "last", 1)))

    def drop():
        nonlocal waiting
        waiting = None
        held.clear()
        gc.collect()

    statuses = [in_a_child(drop)]
    while not waiting.done():
        statuses.append(in_a_child(drop))
    owner.stop()
    assert set(statuses) == {0}


def test_the_last_part_of_a_large_message_is_logged_as_others(source, inbox, inboxes, buffer, capfd):
    many = [transform("map", f"robot {number}", 1) for number in range(MANY)]
    source.put(serialized(*many, unnormalized()))
    assert buffer.can_transform("map", "odd", LATEST)
    inboxes.report_next()
    assert errors_so_far().count("to child_frame_id 'odd' ") == 1


def resident_bytes():
    """Of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def test_a_flood_of_faults_is_counted_and_only_a_part_of_it_kept_for_the_log(source, buffer, inboxes):
    handed, torn, many = [], b"torn" + bytes(1 << 18), 1000
    inbox = Inbox(source, handed.append, inboxes=inboxes)
    inbox.fill(buffer)
    future = buffer.wait_for_transform_async("map", "robot", at(1))
    future.add_done_callback(lambda _: None)
    before = resident_bytes()
    for message in (*[torn] * many, serialized(transform("map", "robot", 1))):
        source.put(message)
        inbox.catch_up()
    assert resident_bytes() - before < many * len(torn) / 4
    assert buffer.statistics()["malformed_messages"] == many
    inboxes.report_next()
    assert handed == [future]
    inbox.close()


def unnormalized():
    odd = transform("map", "odd", 1)
    odd.transform.rotation.w = 1.1
    return odd


def test_what_was_put_before_a_large_message_and_after_it_is_found_too(source, inbox, buffer):
    source.put(serialized(transform("map", "before", 1)))
    source.put(serialized(*(transform("map", f"frame{i}", 1) for i in range(MANY))))
    source.put(serialized(transform("map", "after", 1)))
    assert buffer.can_transform("map", "after", LATEST)
    assert len(buffer.frames()) == MANY + 3  # with the map
    buffer._self_check()


@pytest.mark.parametrize("seed", seeds(2, 20))
def test_each_message_goes_once_and_whole_into_one_buffer(source, inboxes, seed):
    """Also a long one, with which several threads go on in turn while the inbox gets another buffer."""
    rng, ended = random.Random(seed), threading.Event()
    buffers = [Buffer(), Buffer()]
    inbox = Inbox(source, list, inboxes=inboxes)
    sizes = [rng.choice([1, 100, MANY]) for _ in range(10)]
    contents = [[transform("map", f"{n} {i}", 1) for i in range(size)] for n, size in enumerate(sizes)]
    messages = [encode(transforms) for transforms in contents]

    def taken():
        return sum(buffer.statistics()["taken"] for buffer in buffers)

    def refill():
        while not ended.is_set():
            inbox.fill(rng.choice(buffers))

    def read():
        while not ended.is_set():
            taken()

    with ThreadPoolExecutor() as threads:
        threads.submit(inboxes.drain_when_due)
        others = [threads.submit(work) for work in (refill, read, read)]
        try:
            for message in messages:
                source.put(message)
            until(lambda: taken() >= sum(sizes))
        finally:
            ended.set()
            for other in others:
                other.result()
            inboxes.stop()
    found = [Counter(name.split()[0] for name in buffer.frames()) for buffer in buffers]
    for number, size in enumerate(sizes):
        assert sorted(one[str(number)] for one in found) == [0, size]
    assert taken() == sum(sizes)
    inbox.close()


def test_what_was_put_while_there_was_no_buffer_goes_into_the_next_one(source, inbox, buffer, tf2_ros):
    inbox.fill(None)
    source.put(serialized(transform("map", "robot", 1)))
    assert not buffer.can_transform("map", "robot", LATEST)
    other = tf2_ros.Buffer()
    inbox.fill(other)
    assert other.can_transform("map", "robot", LATEST)
    assert not buffer.can_transform("map", "robot", LATEST)


def test_an_interrupt_while_answers_are_handed_over_is_raised_after_the_last_one(
    source, buffer, tf2_ros, inboxes
):
    handed = []

    def hand_over(call):
        handed.append(call)
        if len(handed) == 1:
            signal.raise_signal(signal.SIGINT)

    inbox = Inbox(source, hand_over, inboxes=inboxes)
    inbox.fill(buffer)
    futures = [buffer.wait_for_transform_async("map", "robot", at(second)) for second in (1, 2)]
    for future in futures:
        future.add_done_callback(lambda _: None)
    for second in (1, 2):
        source.put(serialized(transform("map", "robot", second)))
    inbox.catch_up()
    with pytest.raises(KeyboardInterrupt):
        inbox.fill(tf2_ros.Buffer())
    assert set(handed) == set(futures)
    inbox.close()


def test_one_thread_drains_without_a_reader_and_another_reports_until_they_are_stopped(
    source, inbox, inboxes, buffer, capfd
):
    receiver = threading.Thread(target=inboxes.drain_when_due)
    receiver.start()
    source.put(serialized(transform("map", "map", 1)))
    until(
        lambda: (
            inboxes.await_report(time.monotonic_ns() + S)
            and not inboxes.report_next()
            and "TF_SELF" in errors_so_far()
        )
    )
    inboxes.stop()
    receiver.join()
    inboxes.drain_when_due()
    assert not inboxes.await_report(time.monotonic_ns() + S)


class Slow:
    """What takes a while to end at its timeout."""

    ended = 0

    def __init__(self):
        self.over = bool  # False

    def expire(self):
        until_s = time.monotonic() + 0.0001
        while time.monotonic() < until_s:
            pass
        Slow.ended += 1


def test_an_answer_does_not_wait_for_the_ends_of_many_timeouts(source, inbox, inboxes, buffer):
    background = Background(inboxes)
    future = buffer.wait_for_transform_async("map", "robot", at(1))
    many = [Slow() for _ in range(10_000)]
    for one in many:
        background.expire_at(0, one)
    source.put(serialized(transform("map", "robot", 1)))
    inbox.catch_up()
    until(future.done)
    assert Slow.ended < len(many)


def test_inboxes_report_in_the_order_in_which_they_had_something_to_report(tf2_ros, inboxes):
    handed, buffers, sources, filled = [], [], [], []
    for number in range(4):
        sources.append(compiled("listed_source").ListedSource())
        buffers.append(tf2_ros.Buffer())
        filled.append(Inbox(sources[-1], lambda _, number=number: handed.append(number), inboxes=inboxes))
        filled[-1].fill(buffers[-1])
    futures = [one.wait_for_transform_async("map", "robot", LATEST) for one in buffers]
    for future in futures:
        future.add_done_callback(lambda _: None)
    for number in (2, 0, 3):
        sources[number].put(serialized(transform("map", "robot", 1)))
        filled[number].catch_up()
    filled[0].close()  # which reports
    assert handed == [0]
    for expected in ([0, 2], [0, 2, 3], [0, 2, 3]):
        inboxes.report_next()
        assert handed == expected
    for one in filled:
        one.close()


def test_a_closed_inbox_fills_no_buffer(source, buffer, inboxes):
    inbox = Inbox(source, list, inboxes=inboxes)
    source.put(serialized(*[transform("map", f"robot {number}", 1) for number in range(MANY)]))
    inbox.close()
    inbox.fill(buffer)  # as a thread does that gives a listener another buffer meanwhile
    assert not buffer.can_transform("map", "robot 0", at(1))
    alive = weakref.ref(inbox)
    del inbox
    assert alive() is None


def test_an_inbox_in_garbage_ends_before_the_collector_clears_what_threads_use(inboxes):
    class Listed(compiled("listed_source").ListedSource):
        pass

    source, are_whole = Listed(), []
    source.observer = Observer()
    source.when_silent = lambda source: are_whole.append(hasattr(source, "observer"))
    source.inbox_of_it = inbox = Inbox(source, list, inboxes=inboxes)
    inbox.add_observer(source.observer)
    del inbox, source
    gc.collect()
    assert are_whole == [True]


def test_an_inbox_that_is_destroyed_reports_nothing(buffer, inboxes):
    for _ in range(3):
        source = compiled("listed_source").ListedSource()
        inbox = Inbox(source, list, inboxes=inboxes)
        inbox.fill(buffer)
        source.put(b"torn")
        inbox.catch_up()
        other = Buffer()
        inbox.fill(other)  # which reports
        source.put(b"torn")
        other.can_transform("map", "robot", LATEST)
        del other  # before its inbox
        del inbox
    inboxes.report_next()
    assert buffer.statistics()["malformed_messages"] == 3
