# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wait in tests for what threads, executors and other processes do."""

import os
import threading
import time

# A sanitizer makes everything slower; see reliability/sanitize.py.
SLOWNESS = float(os.environ.get("TF2_TEST_SLOWNESS", "1"))
# What a busy machine keeps, too.
DEADLINE_S = 60.0 * SLOWNESS
# For what does not wait, where it would otherwise do so until the deadline.
PROMPT_S = DEADLINE_S / 2


# In which the middleware tells the name of a node, if it does: usually a tenth of a second.
TOLD_S = DEADLINE_S / 4
NEVER_TOLD = 75  # the status of a program that lacks one after this time


class NeverTold(AssertionError):
    """The name of a node, which is all that a test still needs; see `excused_faults.py`."""


def until(condition, executor=None):
    """Spin, or let other threads work, until the condition holds; its value."""
    return _until(condition, executor, DEADLINE_S, AssertionError("it did not happen"))


def until_told(condition, executor=None):
    """The same, for a condition that lacks only the name of a node, once all else was waited for."""
    return _until(condition, executor, TOLD_S, NeverTold("the middleware did not tell the name of a node"))


def _until(condition, executor, seconds, failure):
    deadline = time.monotonic() + seconds
    while not (value := condition()):
        if time.monotonic() >= deadline:
            raise failure
        if executor is None:
            threading.Event().wait(0.005)
        else:
            executor.spin_once(timeout_sec=0.02)
    return value


def errors_so_far():
    """
    What was written to stderr, in a test with the fixture `capfd`.

    For `until`: `capfd.readouterr()` empties what it has read, and with it what other threads and processes
    write in between.
    """
    return os.pread(2, os.fstat(2).st_size, 0).decode("utf-8", "replace")


def once_waiting(buffer, call):
    """Call in a thread, once a wait of the buffer is pending."""

    def run():
        until(lambda: buffer.statistics()["waiters"])
        call()

    thread = threading.Thread(target=run)
    thread.start()
    return thread


def seconds_of(call):
    """How long a call took, and what it raised."""
    begin = time.monotonic()
    try:
        call()
    except Exception as error:
        return time.monotonic() - begin, error
    return time.monotonic() - begin, None
