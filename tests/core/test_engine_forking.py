"""A forked child of a process whose other threads are in the middle of something with a buffer."""

import gc
import itertools
import os
import threading

import numpy as np
import pytest
from forking import fork, in_a_child, status_of
from making import at, transform
from processes import until
from repetitions import times

pytestmark = pytest.mark.ours

FORKS = times(10, 30)
S = 10**9
SAMPLES = 100
TIMES_NS = np.linspace(1 * S, 2 * S, 500_000).astype(np.int64)


@pytest.fixture
def core(tf2_py):
    core = tf2_py.BufferCore()
    fill(core)
    return core


def fill(core):
    for i in range(SAMPLES + 1):
        core.set_transform(transform("map", "robot", ns=1 * S + i * S // SAMPLES), "me")


# What a thread each does, again and again, while the process forks.
BUSINESS = (
    lambda core, n: core.lookup_transforms("map", "robot", TIMES_NS),
    lambda core, n: core.set_transform(transform("map", "other", ns=1 * S + n), "me"),
    lambda core, n: core.set_transforms(
        [transform("map", f"other{i}", ns=1 * S + n) for i in range(300)], "me"
    ),
    lambda core, n: core.all_frames_as_yaml(),
    lambda core, n: core._wait("map", "nowhere", at(1)).wait_for(1_000_000, lambda: True),
    lambda core, n: type(core)().set_transform(transform("a", "b", 1), "me"),
    # It takes many slices: the cup gets another parent, so all its waiters are tried.
    lambda core, n: core.set_transform(transform(f"hand {n % 2}", "cup", ns=2 * S + n * 10_000_000), "me"),
    lambda core, n: (gc.collect(), os.waitpid(fork(lambda: None), 0)),
)


def use(core):
    """All that a child may do with a buffer."""
    core._self_check()
    assert core.lookup_transform_core("map", "robot", at(1.5)).child_frame_id == "robot"
    assert len(core.lookup_transforms("map", "robot", TIMES_NS[:5000])[0]) == 5000
    assert "robot" in core.all_frames_as_yaml() and "robot" in core.tree() and "robot" in core
    assert repr(core).endswith(", 0 waiters>")
    answers = []
    wait = core._wait("map", "child", at(1), notify=answers.append)
    assert not core._wait("map", "nowhere", at(1)).wait_for(1_000_000, lambda: True)
    core.set_transform_static(transform("map", "child"), "child")
    assert answers[0].child_frame_id == "child"
    assert not wait.cancel()
    core.clear()
    core._self_check()
    other = type(core)()
    other.set_transform(transform("map", "robot", 1), "child")
    assert other.can_transform_core("map", "robot", at(1))[0]


def test_it_uses_a_buffer_that_other_threads_of_its_parent_were_using(core):
    ending, busy = threading.Event(), set()
    core.set_transform(transform("map", "cup", 1), "me")
    waits = [core._wait("nest", "cup", at(1 + i / 10_000), notify=print) for i in range(5000)]

    def use_and_drop():
        assert repr(core).endswith(", 0 waiters>")
        core.set_transform_static(transform("nest", "cup"), "me")
        assert not any(wait.answer or wait.cancel() for wait in waits)
        waits.clear()
        use(core)

    def work(business):
        for n in itertools.count():
            business(core, n)
            busy.add(business)
            if ending.is_set():
                return

    threads = [threading.Thread(target=work, args=(business,)) for business in BUSINESS]
    for thread in threads:
        thread.start()
    try:
        until(lambda: len(busy) == len(BUSINESS))
        statuses = [in_a_child(use_and_drop) for _ in range(5 * FORKS)]
    finally:
        ending.set()
        for thread in threads:
            thread.join()
    assert statuses == [0] * 5 * FORKS
    core._self_check()
    assert core.can_transform_core("map", "robot", at(1.5))[0]


class TestWaitsOfTheParent:
    def test_a_child_has_forgotten_them_and_a_grandchild_uses_what_its_parent_made(self, core):
        answers, ending = [], threading.Event()
        waits = [core._wait("map", child, at(1), notify=answers.append) for child in ("cup", "nowhere")]
        waits.append(core._wait("map", "cup", at(1)))
        blocked = core._wait("map", "nowhere", at(1))
        thread = threading.Thread(target=blocked.wait_for, args=(100 * S, lambda: not ending.is_set()))
        thread.start()

        def use_and_drop():
            assert core.statistics()["waiters"] == 0
            assert core._pending_waits() == []
            core.set_transform_static(transform("map", "cup"), "child")
            core._self_check()
            assert [wait.answer for wait in waits] == [None] * 3
            assert not any(wait.cancel() for wait in waits)
            assert waits[0].reason() is None
            assert "nowhere" in str(waits[1].reason())
            assert not waits[2].wait_for(100 * S, lambda: True)
            waits.clear()
            gc.collect()
            assert answers == []
            assert in_a_child(lambda: use(core)) == 0
            use(core)

        try:
            assert in_a_child(use_and_drop) == 0
            assert core.statistics()["waiters"] == 4
        finally:
            ending.set()
            thread.join()
        core.set_transform_static(transform("map", "cup"), "me")
        assert [wait.answer is not None for wait in waits] == [True, False, True]
        assert len(answers) == 1

    def test_a_child_that_one_of_them_makes_does_not_tell_the_others(self, core):
        def split_and_tell():
            child, told = None, []

            def split(_):
                nonlocal child
                child = os.fork()

            waits = [core._wait("map", "cup", at(1), notify=split)]
            waits += [core._wait("map", "cup", at(1), notify=told.append) for _ in range(3)]
            core.set_transform_static(transform("map", "cup"), "me")
            if child:
                assert len(told) == 3
                assert status_of(child) == 0
            else:
                assert told == []
                waits.clear()
                use(core)

        assert in_a_child(split_and_tell) == 0
