# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""No thread of the tools begins once Python ends, also if a signal handler interrupts the start of one."""

import sys
import threading

import pytest
from interposed_libraries import with_library
from processes import run
from waiting import DEADLINE_S

from tf2_ros_tools.common.threads import start_and_wait

PROGRAM = """
import signal, threading
from argparse import Namespace
from contextlib import suppress
from tf2_ros_tools.live.transport import WireThread
from tf2_ros_tools.nodes.node_session import spun_node

def wire():
    WireThread("a wire", threading.Event().wait, print)

def node():
    with spun_node("ending", Namespace(ros_arguments=[])):
        pass

signal.signal(signal.SIGALRM, signal.default_int_handler)
start = threading.Thread.start
def interrupted(thread):
    threading.Thread.start = start
    signal.setitimer(signal.ITIMER_REAL, 0.1)  # in the middle of the delay of `late_threads.c`
    start(thread)
threading.Thread.start = interrupted
with suppress(KeyboardInterrupt):
    {what}()
    print("it was not interrupted")
print("at the end", flush=True)
"""


@pytest.mark.parametrize("what", ["wire", "node"])
def test_one_whose_start_is_interrupted_begins_before_python_ends(what, tmp_path):
    environment = with_library("late_threads", tmp_path) | {
        "MALLOC_PERTURB_": "165",
        "GLIBC_TUNABLES": "glibc.malloc.tcache_count=0",
    }
    done = run(sys.executable, "-c", PROGRAM.replace("{what}", what), env=environment)
    assert (done.returncode, done.stdout, done.stderr) == (0, "at the end\n", "")


def test_once_started_a_thread_runs():
    ran = threading.Event()
    thread = threading.Thread(target=ran.set)
    start_and_wait(thread)
    assert thread.ident is not None
    assert ran.wait(DEADLINE_S)
    thread.join(DEADLINE_S)


def test_none_starts_once_python_ends():
    program = """
import atexit, threading
def start():
    try:
        threads.start_and_wait(threading.Thread(target=print))
    except RuntimeError as error:
        print(error)
atexit.register(start)  # runs last
from tf2_ros_tools.common import threads
"""
    done = run(sys.executable, "-c", program)
    assert (done.stdout, done.stderr) == ("cannot start a thread while Python ends\n", "")
