# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Let the threads that end timeouts and run callbacks do what is due before a test counts what is left."""

import threading
import time

from waiting import DEADLINE_S

from tf2_ros._process.background import background
from tf2_ros._process.threads import callbacks


class LastTimeout(threading.Event):
    """A timeout that is set once the thread for callbacks has made the calls that were put before it."""

    def over(self):
        return False

    def expire(self):
        callbacks.put(self.set)


def let_helper_threads_finish(within_ns=0):
    """
    Return once all timeouts that are due within this time have ended, and the callbacks so far have returned.

    Whoever counts waiters calls this first: a future is done a moment before its waiter is gone, and a
    callback may itself be waiting.
    """
    last = LastTimeout()
    background.expire_at(time.monotonic_ns() + within_ns, last)
    assert last.wait(DEADLINE_S), "a callback does not return"
