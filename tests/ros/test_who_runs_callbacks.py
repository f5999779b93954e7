# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Which thread runs code of a program: each row of the table in `internals.md`."""

import logging
import sys
import threading

import pytest
from paths import ROOT
from sensor_msgs.msg import LaserScan
from spinning_nodes import EXECUTOR, spinning
from times_and_transforms import S, at, insert, transform
from waiting import until

CALLER, CALLBACKS = threading.main_thread().name, "tf2_ros callbacks"


class Clock:
    ns = 100 * S

    def now(self):
        return self.ns


class Ran:
    """A buffer, a node, and which threads have run code of the program."""

    def __init__(self, tf2_ros, node, peer):
        self.tf2_ros, self.node, self.peer, self.threads = tf2_ros, node, peer, []
        self.buffer = tf2_ros.Buffer()
        self.listener = tf2_ros.TransformListener(self.buffer, node)

    def note(self, *_):
        self.threads.append(threading.current_thread().name)

    def future(self, ns=S, source="base", **options):
        future = self.buffer.wait_for_transform_async("map", source, ns, **options)
        future.add_done_callback(self.note)
        return future

    def in_a_loop(self, ns):
        """A wait for which only the end of a loop is missing."""
        for parent, child in (("map", "odom"), ("odom", "x"), ("odom", "base")):
            self.buffer.set_transform_static(transform(parent, child), "test")
        insert(self.buffer, "odom", "map", ns / S)
        future = self.buffer.wait_for_transform_async("x", "base", ns)
        assert not future.done()
        future.add_done_callback(self.note)

    def silence(self, _):
        self.note()
        return "nothing arrives"


def by_the_program(ran):
    ran.future()
    insert(ran.buffer, "map", "base", 1)


def by_an_inbox(ran):
    ran.future()
    ran.peer().send(("map", "base", S, 1))


def timeout(ran):
    ran.future(timeout=0.01)


def available(ran):
    insert(ran.buffer, "map", "base", 1)
    ran.buffer.on_change("map", "base", ran.note)


def cleared(ran):
    ran.in_a_loop(S)
    ran.buffer.clear()


def set_back_as_a_check_notices(ran):
    buffer = type("Mine", (ran.tf2_ros.Buffer,), {"time_jump_callback": ran.note})()
    ran.listener.buffer = ran.buffer = buffer
    buffer.clock = Clock()
    insert(buffer, "map", "arm", 99)
    buffer.ages("map", "arm")
    ran.in_a_loop(99 * S)
    buffer.on_change("map", "other", print, max_age=1)
    buffer.clock.ns -= 10 * S
    until(lambda: len(ran.threads) == 2)
    assert not {"arm", "map"} & buffer.histories().keys()


def error_of_a_timeout(ran):
    source = ran.buffer.add_source("this test", ran.silence)
    future = ran.buffer.wait_for_transform_async("map", "base", 0, timeout=0.01)
    until(future.done)
    assert "nothing arrives" in str(future.exception())
    source.end()


def error_of_a_filters_timeout(ran):
    source = ran.buffer.add_source("this test", ran.silence)
    messages = ran.tf2_ros.MessageFilter(None, ran.buffer, "map", 10, node=ran.node, buffer_timeout=0.01)
    scan = LaserScan()
    scan.header.frame_id, scan.header.stamp.sec = "laser", 5
    messages.add(scan)
    until(lambda: messages.statistics()["dropped"]["TIMEOUT"])
    source.end()


def error_of_a_lookup(ran):
    source = ran.buffer.add_source("this test", ran.silence)
    assert not ran.buffer.can_transform("map", "base", at(1), return_debug_tuple=True)[0]
    source.end()


def log_line(ran):
    with pytest.MonkeyPatch.context() as patch:
        patch.delitem(sys.modules, "rclpy.logging")  # as without rclpy
        handler = logging.Handler()
        handler.emit = ran.note
        logger = logging.getLogger("tf2_ros")
        logger.addHandler(handler)
        ran.buffer.clock = Clock()
        ran.buffer.on_change("map", "other", print, max_age=1)
        ran.buffer.clock = type("Broken", (), {"now": lambda _: 1 / 0})()
        until(lambda: ran.threads)
        logger.removeHandler(handler)


def canceled(ran):
    ran.future().cancel()


# By the beginning of a row: what does it, the thread if an executor spins the node, and if none does.
ROWS = {
    "the program's `set_transform`": [(by_the_program, CALLER, CALLER)],
    "an insert by an inbox": [(by_an_inbox, EXECUTOR, None)],
    "the timeout": [(timeout, EXECUTOR, CALLBACKS)],
    "the transform was available": [(available, CALLER, CALLER)],
    "`clear` or `forget`": [(cleared, CALLER, CALLER)],
    "a clock that was set back before a timeout": [(set_back_as_a_check_notices, EXECUTOR, CALLBACKS)],
    "the text of an error": [
        (error_of_a_timeout, CALLBACKS, CALLBACKS),
        (error_of_a_filters_timeout, CALLBACKS, CALLBACKS),
        (error_of_a_lookup, CALLER, CALLER),
    ],
    "a log line of the background thread": [(log_line, CALLBACKS, CALLBACKS)],
    "`cancel`": [(canceled, CALLER, CALLER)],
}


@pytest.mark.parametrize("is_spun", [True, False])
@pytest.mark.parametrize(("cause", "spun", "unspun"), [one for row in ROWS.values() for one in row])
def test_a_cause_runs_code_of_the_program_in_the_thread_of_its_row(
    tf2_ros, node, executor, peer, cause, spun, unspun, is_spun
):
    ran = Ran(tf2_ros, node, peer)
    if is_spun:
        with spinning(executor):
            cause(ran)
            until(lambda: ran.threads)
        assert {*ran.threads} == {spun}
    elif unspun is not None:
        executor.remove_node(node)
        cause(ran)
        until(lambda: ran.threads)
        assert {*ran.threads} == {unspun}
    ran.listener.unregister()


def test_the_page_has_these_rows():
    page = (ROOT / "docs/development/internals.md").read_text(encoding="utf-8")
    table = page.partition("| what ends the wait")[2].partition("\n\n")[0]
    rows = [line.split("|")[1].strip() for line in table.splitlines()[2:]]
    assert len(rows) == len(ROWS)
    assert all(row.startswith(begin) for row, begin in zip(rows, ROWS, strict=True)), rows
