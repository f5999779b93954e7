# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Children of a process, and how they end."""

import os
import signal
import sys
import time
import traceback

# What a child that does not hang never takes.
CHILD_S = 60.0 * float(os.environ.get("TF2_TEST_SLOWNESS", "1"))


def fork(what):
    """Fork a child that does this and ends at once; its process id."""
    child = os.fork()
    if child == 0:
        try:
            what()
            sys.stderr.flush()
            os._exit(0)
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(1)
    return child


def status_of(child):
    """How a child ended: its exit status, or minus the signal; one that hangs is killed."""
    deadline = time.monotonic() + CHILD_S
    while True:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() > deadline:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.001)


def in_a_child(what):
    """Do this in a forked child; its exit status."""
    return status_of(fork(what))
