# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""All answers of a call for many times belong to one state of the buffer, whatever is inserted meanwhile."""

import itertools
import re
import threading
from typing import NamedTuple

import numpy as np
import pytest
from times_and_transforms import S, transform

from tf2_py import BufferCore, ExtrapolationException

TIMES = np.linspace(S, 2 * S, 20_000).astype(np.int64)
CHANGED = 20  # calls during which the buffer has changed


def filled():
    buffer = BufferCore(float("inf"))
    buffer.set_transforms([transform("map", "base", seconds) for seconds in (1, 2)], "x")
    move_camera(buffer, 0)
    return buffer


def move_camera(buffer, n, parent="base"):
    buffer.set_transform_static(transform(parent, "camera", xyz=(n, 0, 0)), "x")


def move_base(buffer, n):
    buffer.set_transform(transform("map", "base", ns=2 * S + n), "x")


def keep_map(buffer):
    buffer.set_transform_static(transform("map", "dock"), "x")


def connect(buffer, n):
    if n % 2:
        buffer.forget("base")
    else:
        buffer.set_transform_static(transform("map", "base"), "x")


def give_base_two_parents(buffer):
    buffer.set_transform(transform("odom", "base", 1.5), "x")
    buffer.set_transform_static(transform("map", "odom"), "x")


def close_a_loop_once(buffer):
    buffer.set_transform(transform("base", "map", 1), "x")
    buffer.forget("map")


LONG_PATH = ["base", *(f"link{i}" for i in range(70))]


def lengthen_the_path(buffer):
    links = itertools.pairwise(LONG_PATH)
    buffer.set_transforms([transform(parent, child) for parent, child in links], "x", True)
    move_camera(buffer, 0, LONG_PATH[-1])


class Case(NamedTuple):
    arguments: dict = {}  # of the lookups
    prepare: object = lambda buffer: None
    change: object = lambda buffer, n: None  # together with the camera
    mount: str = "base"  # of the camera


CASES = {
    "batches": Case(),
    "two times": Case({"fixed_frame": "map", "target_time": S}),
    "frames that are connected meanwhile": Case({"on_missing": "nan"}, keep_map, connect),
    "several parents": Case(prepare=give_base_two_parents),
    "a tree that had a loop": Case(prepare=close_a_loop_once),
    "a long path": Case(prepare=lengthen_the_path, mount=LONG_PATH[-1]),
    "tolerance": Case({"tolerance": 1.0}),
    "max_gap": Case({"max_gap": 5.0, "on_missing": "nan"}),
}


class Writer:
    """Moves the camera, and more, in a thread, again and again; counts how often."""

    def __init__(self, buffer, case):
        self.buffer, self.case = buffer, case
        self.count, self._ends = 0, threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self):
        while not self._ends.is_set():
            move_camera(self.buffer, self.count + 1, self.case.mount)
            self.case.change(self.buffer, self.count + 1)
            self.count += 1

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ends.set()
        self._thread.join()


def calls_with_changes(writer, call):
    """The results of as many calls as are wanted, in which the writer has written."""
    found = []
    while len(found) < CHANGED:
        before = writer.count
        result = call()
        if writer.count > before + 1:
            found.append(result)
    return found


@pytest.mark.parametrize("name", CASES)
def test_all_answers_of_a_call_belong_to_one_state(name):
    buffer, case = filled(), CASES[name]
    case.prepare(buffer)
    with Writer(buffer, case) as writer:
        results = calls_with_changes(
            writer, lambda: buffer.lookup_transforms("map", "camera", TIMES, **case.arguments)[0][:, 0]
        )
    assert [len(np.unique(xs)) for xs in results] == [1] * CHANGED  # NaN is a value, too


@pytest.mark.parametrize(
    "arguments", [{}, {"max_gap": 5.0}, {"fixed_frame": "map", "target_time": S}], ids=str
)
def test_a_time_that_arrives_meanwhile_does_not_mix_states(arguments):
    buffer, points, texts = filled(), np.zeros((len(TIMES), 3)), []

    def call():
        newest_ns = buffer.get_latest_common_time("map", "base").nanoseconds
        times = TIMES.copy()
        times[-1] = newest_ns + 50
        try:
            xs = buffer.transform_points(points, times, "map", "camera", **arguments)[:, 0]
        except ExtrapolationException as error:
            texts.append(str(error))
        else:
            assert len(np.unique(xs)) == 1

    with Writer(buffer, Case(change=move_base)) as writer:
        calls_with_changes(writer, call)
    wanted = (
        rf"times\[{len(TIMES) - 1}\]: Lookup would require extrapolation into the future\.  "
        r"Requested time 2\.(\d{9}) but the latest data is at time 2\.(\d{9}), when .*; "
        r"the newest sample of base \(parent map\) at 2\.(\d{9}) is 0\.(\d{9}) s too old"
    )
    for text in texts:
        requested, quoted, newest, apart = map(int, re.fullmatch(wanted, text).groups())
        assert quoted == newest == requested - apart
