"""Waiting in the engine: no wake-up is lost, and an insert looks only at those it can help."""

import gc
import threading
import time
from functools import partial

import pytest
from making import S, at, at_ns, stamp_ns, transform
from ros_optional import Duration

pytestmark = pytest.mark.ours


@pytest.fixture
def buffer(tf2_py):
    return tf2_py.BufferCore(Duration(seconds=10))


def always():
    return True


class Untrue(Exception):
    """One that cannot be asked whether it is true."""

    def __bool__(self):
        raise ValueError


class Falsy(Exception):
    """One that counts as false."""

    def __len__(self):
        return 0


def test_many_answers_of_one_insert_come_in_the_order_of_the_waits(buffer):
    """As tf2 gives them, whatever times they wait for."""
    buffer.set_transforms([transform("map", "odom", 0.5), transform("map", "odom", 1)], "x")
    order = []
    waits = [
        buffer._wait("map", "odom", at(second), notify=lambda m: order.append(stamp_ns(m) // S))
        for second in (5, 2, 4, 9, 3)
    ]
    buffer.set_transform(transform("map", "odom", 5.5), "x")
    assert order == [5, 2, 4, 3]
    assert [w.answer is not None for w in waits] == [True, True, True, False, True]


def test_a_wait_in_a_cycle_is_collected(buffer):
    class Holder:
        pass

    holder = Holder()
    holder.wait = buffer._wait("map", "odom", at(1), notify=lambda m, h=holder: None)
    del holder
    gc.collect()
    assert buffer.statistics()["waiters"] == 0
    buffer.set_transform(transform("map", "odom", 1), "x")


def test_whoever_is_notified_may_wait_insert_and_cancel(buffer):
    seen = []
    waits = []

    def again(message):
        seen.append(message)
        other.cancel()
        waits.append(buffer._wait("map", "odom", at(3), notify=seen.append))
        buffer.set_transform(transform("map", "odom", 4), "x")

    other = buffer._wait("map", "odom", at(2), notify=seen.append)
    waits.append(buffer._wait("map", "odom", at(1), notify=again))
    buffer.set_transform(transform("map", "odom", 1), "x")
    assert [stamp_ns(m) // S for m in seen] == [1, 3]


@pytest.mark.parametrize("bad", ["", "/map"])
def test_a_name_that_no_lookup_accepts_is_raised_at_once(tf2_py, buffer, bad):
    for ends in ((bad, "odom"), ("odom", bad)):
        with pytest.raises(tf2_py.InvalidArgumentException):
            buffer._wait(*ends, at(1))
    with pytest.raises(tf2_py.InvalidArgumentException):
        buffer.set_transform_static(transform("map", "odom"), "x")
        buffer._wait("map", "odom", at(1), bad, at(1))
    assert buffer.statistics()["waiters"] == 0


@pytest.mark.parametrize("error", [Untrue, Falsy])
def test_whatever_one_of_them_raises_all_are_notified(buffer, error):
    told = set()

    def notify(number, _):
        told.add(number)
        raise error

    waits = [buffer._wait("a", "b", at(5), notify=partial(notify, number)) for number in range(5)]
    buffer.set_transform(transform("a", "b", 4), "test")
    with pytest.raises(error):
        buffer.set_transform(transform("a", "b", 6), "test")
    assert len(told) == 5
    assert not any(wait.cancel() for wait in waits)


def test_cancelling_is_too_late_where_the_answer_is_there(buffer):
    cancelled = []
    first = buffer._wait("a", "b", at(5), notify=lambda _: cancelled.append(second.cancel()))
    second = buffer._wait("a", "b", at(5), notify=lambda _: None)
    buffer.set_transforms([transform("a", "b", 4), transform("a", "b", 6)], "test")
    assert cancelled == [False]
    assert first.answer is not None
    assert second.answer is not None


def test_the_others_are_served_while_one_insert_helps_many(buffer):
    # More than one slice: both threads' inserts and all of their waiters go through each other.
    buffer.set_transform(transform("a", "b", 1), "test")
    buffer.set_transform(transform("a", "c", 1), "test")
    told = {"b": [], "c": []}
    waits = [
        buffer._wait("a", child, at_ns(2 * S + i), notify=told[child].append)
        for i in range(2000)
        for child in told
    ]

    def insert(child):
        buffer.set_transform(transform("a", child, 3), "test")
        assert len(told[child]) == 2000, "an insert returned before those whom it completed were told"

    threads = [threading.Thread(target=insert, args=(child,)) for child in told]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(wait.answer is not None for wait in waits)
    assert {child: len(answers) for child, answers in told.items()} == {"b": 2000, "c": 2000}
    buffer._self_check()


def test_waits_are_made_by_buffers_alone(buffer):
    cls = type(buffer._wait("map", "map", at(1)))
    with pytest.raises(TypeError):
        cls()
    del buffer
    cls.__new__(cls)  # and dropping it does no harm


class TestBlocking:
    def test_a_thread_sleeps_until_the_answer(self, buffer):
        wait = buffer._wait("map", "odom", at(1))
        timer = threading.Timer(0.05, buffer.set_transform, (transform("map", "odom", 1), "x"))
        timer.start()
        assert wait.wait_for(10 * S, always)
        assert wait.answer == buffer.lookup_transform_core("map", "odom", at(1))
        timer.join()

    @pytest.mark.parametrize("timeout_ns", [0, 1, 300_000, 250_000_000])
    def test_a_timeout_is_kept(self, buffer, timeout_ns):
        wait = buffer._wait("map", "odom", at(1))
        began = time.monotonic_ns()
        assert not wait.wait_for(timeout_ns, always)
        assert time.monotonic_ns() - began >= timeout_ns
        assert buffer.statistics()["waiters"] == 0

    def test_the_end_of_the_context_ends_it(self, buffer):
        looks = iter([True, True, False])
        assert not buffer._wait("map", "odom", at(1)).wait_for(60 * S, lambda: next(looks))

    def test_what_is_raised_meanwhile_ends_it(self, buffer):
        def interrupted():
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            buffer._wait("map", "odom", at(1)).wait_for(60 * S, interrupted)
        assert buffer.statistics()["waiters"] == 0


def test_inserts_and_registrations_interleave_in_threads(buffer):
    # Each reader waits for every stamp before it comes; one lost wake-up would let it sleep to its deadline.
    seconds = 2000
    reached = [0, 0]

    def read(i):
        for second in range(1, seconds):
            wait = buffer._wait("map", "odom", at_ns(second * 1000))
            if not wait.wait_for(20 * S, always):
                return
            reached[i] = second

    readers = [threading.Thread(target=read, args=(i,)) for i in range(2)]
    for reader in readers:
        reader.start()
    for second in range(1, seconds):
        buffer.set_transform(transform("map", "odom", ns=second * 1000), "x")
        while min(reached) < second - 3 and all(r.is_alive() for r in readers):
            time.sleep(0)  # let the readers come near, or the writer would be done before they have begun
    for reader in readers:
        reader.join()
    assert reached == [seconds - 1] * 2
    assert buffer.statistics()["waiters"] == 0
