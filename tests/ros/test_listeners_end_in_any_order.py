# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Listeners, their nodes and their contexts end in every order, and nothing is left of them.

In a file of its own: `pytest --all` repeats it for minutes, and a file's tests run in one process.
"""

import sys

import pytest
from excused_faults import tried
from interposed_libraries import with_library
from paths import PROGRAMS
from processes import run
from random_runs import times

# Of lark, which rclpy imports with its first node.
IGNORED = "ignore:module 'sre_:DeprecationWarning"


@pytest.mark.repeated
@pytest.mark.parametrize("how", ["spun", "not spun"])
def test_nothing_is_left_in_any_order(flood, tmp_path, how):
    flood(200, 5)
    environment = with_library("stack_at_alarm", tmp_path)
    options = ("-W", "error", "-W", IGNORED)
    program = (sys.executable, *options, PROGRAMS / "ends_listeners_in_any_order.py", how, times(40, 200))
    done = tried(lambda: run(*program, env=environment))
    # Zenoh reports each message that arrives just after the end of its subscription.
    lines = done.stderr.splitlines()
    assert [line for line in lines if "[rmw_zenoh_cpp]: SubscriberCallback triggered" not in line] == []
    assert (done.returncode, done.stdout) == (0, "nothing is left\n")
