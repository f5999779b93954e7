# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The helper threads of a process: of several one runs, and one that cannot start another does its work."""

import sys
import threading

import pytest
from interposed_libraries import output_with_library
from processes import run
from waiting import DEADLINE_S, until

from tf2_ros._process import threads


def test_of_several_threads_that_start_one_runs():
    ran = []
    for _ in range(5):
        threads.start_once("of the process", ran.append, "once")
    until(lambda: ran and "of the process" not in [one.name for one in threading.enumerate()])
    assert ran == ["once"]


def test_a_thread_without_the_memory_for_its_object_runs(monkeypatch):
    def without_memory(_):
        raise MemoryError

    ran = threading.Event()
    monkeypatch.setattr(threading.Thread, "start", without_memory)
    threads.start_once("of the process", ran.set)
    assert ran.wait(DEADLINE_S)


NEARLY_FULL = """
import sys
import threading

import rclpy
import tf2_ros

start = threading.Thread.start


def refused(thread):
    if thread.name in ("tf2_ros receiver", "tf2_ros background"):
        raise RuntimeError("can't start new thread")
    start(thread)


threading.Thread.start = refused
rclpy.init()
node = rclpy.create_node("nearly_full")
listener = tf2_ros.TransformListener(tf2_ros.Buffer(), node)
"""


def test_a_process_with_room_for_one_more_thread_ends_without_an_error():
    # The thread that was to start another one does its work.
    done = run(sys.executable, "-c", NEARLY_FULL)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    "what",
    [
        *("timeout", "callback", "listener", "hidden", "spun", "client", "server"),
        *("interrupted hidden", "interrupted spun", "interrupted client"),
    ],
)
def test_python_does_not_end_before_a_thread_that_was_started_has_begun(what, tmp_path):
    overwriting = {"MALLOC_PERTURB_": "165", "GLIBC_TUNABLES": "glibc.malloc.tcache_count=0"}
    printed = output_with_library(
        "late_threads", tmp_path, what, program="exits_while_threads_begin", **overwriting
    )
    assert printed == "at the end\n"


def test_no_thread_starts_once_python_ends():
    program = """
import atexit
atexit.register(lambda: begin())  # runs last
from tf2_ros._process import threads
def begin():
    for _ in range(2):
        try:
            threads.start_once("late", print, "it runs")
        except RuntimeError as error:
            print(error)
"""
    done = run(sys.executable, "-c", program)
    assert (done.stdout, done.stderr) == ("cannot start a thread during interpreter shutdown\n" * 2, "")
