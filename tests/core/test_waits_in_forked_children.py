# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A forked child of a process that waits in a buffer; test_forking.py has one with busy threads."""

import gc
import os
import threading

import numpy as np
import pytest
from forked_children import in_a_child, status_of
from times_and_transforms import at, transform

S = 10**9
TIMES_NS = np.linspace(1 * S, 2 * S, 5000).astype(np.int64)


@pytest.fixture
def core(tf2_py):
    core = tf2_py.BufferCore()
    for i in range(101):
        core.set_transform(transform("map", "robot", ns=1 * S + i * S // 100), "me")
    return core


def use(core):
    """All that a child may do with a buffer."""
    core._self_check()
    assert core.lookup_transform_core("map", "robot", at(1.5)).child_frame_id == "robot"
    assert len(core.lookup_transforms("map", "robot", TIMES_NS)[0]) == 5000
    assert "robot" in core.all_frames_as_yaml() and "robot" in core.tree() and "robot" in core
    assert repr(core).endswith(", 0 waiters>")
    answers = []
    wait = core._wait("map", "child", at(1), notify=answers.append)
    assert not core._wait("map", "nowhere", at(1)).wait_for(1_000_000, lambda: False)
    core.set_transform_static(transform("map", "child"), "child")
    assert answers[0].child_frame_id == "child"
    assert not wait.cancel()
    core.clear()
    core._self_check()
    other = type(core)()
    other.set_transform(transform("map", "robot", 1), "child")
    assert other.can_transform_core("map", "robot", at(1))[0]


class TestWaitsOfTheParent:
    def test_a_child_has_forgotten_them_and_a_grandchild_uses_what_its_parent_made(self, core):
        answers, ending = [], threading.Event()
        waits = [core._wait("map", child, at(1), notify=answers.append) for child in ("cup", "nowhere")]
        waits.append(core._wait("map", "cup", at(1)))
        blocked = core._wait("map", "nowhere", at(1))
        thread = threading.Thread(target=blocked.wait_for, args=(100 * S, ending.is_set))
        thread.start()

        def use_and_drop():
            assert core.statistics()["waiters"] == 0
            core.set_transform_static(transform("map", "cup"), "child")
            core._self_check()
            assert [wait.take() for wait in waits] == [None] * 3
            assert not any(wait.cancel() for wait in waits)
            assert waits[0].reason() is None
            assert "nowhere" in str(waits[1].reason())
            assert not waits[2].wait_for(100 * S, lambda: False)
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
        assert [wait.take() is not None for wait in waits] == [True, False, True]
        assert len(answers) == 1

    def test_a_child_waits_for_the_same_data(self, core):
        """A wait for data of a known frame is filed at that frame."""
        answers, own_answers = [], []
        wait = core._wait("map", "robot", at(2.5), notify=answers.append)

        def wait_and_insert():
            own = core._wait("map", "robot", at(2.5), notify=own_answers.append)
            core.set_transform(transform("map", "robot", 3), "child")
            core._self_check()
            assert (len(answers), len(own_answers)) == (0, 1)
            assert wait.take() is None and not own.cancel()

        assert in_a_child(wait_and_insert) == 0
        core.set_transform(transform("map", "robot", 3), "me")
        assert (len(answers), len(own_answers)) == (1, 0)

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
