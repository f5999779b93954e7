# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Start the programs of the tools, and those that their tests need."""

import shutil
import socket
import subprocess
import sys
from contextlib import contextmanager

import pytest
from processes import end, killed, start
from tool_paths import PROGRAMS
from waiting import NEVER_TOLD, NeverTold


def free_port():
    """A port of this machine on which nobody listens."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def needs_dot(test):
    """Mark a test that runs Graphviz, which `make test` does not install."""
    is_missing = pytest.mark.skipif(shutil.which("dot") is None, reason="Graphviz is not installed")
    return pytest.mark.long("needs Graphviz")(is_missing(test))


def command(name, *arguments, hears=None):
    """
    The words that start one of the programs.

    :param hears: what it must have heard before it ends, instead of listening for a time; see
        `programs/runs_tool_until_heard.py`.
    """
    if hears is None:
        return [sys.executable, "-m", f"tf2_ros_tools.programs.{name}", *arguments]
    return [sys.executable, str(PROGRAMS / "runs_tool_until_heard.py"), hears, name, *arguments]


def heard(*static, **moving):
    """For `hears`: static frames, and how many transforms of others."""
    counts = dict.fromkeys(static, 1) | moving
    one = "frame in streams and streams[frame].count >= count"
    return f"all({one} for frame, count in {counts}.items())"


# The robot of `broadcasting`, long enough for figures.
ROBOT = heard("camera", odom=50, base_link=50)
NAMED_ROBOT = f"{ROBOT} and told()"


@contextmanager
def running(name, *arguments, hears=None, **popen):
    """
    Start one of the programs for a `with` statement, which kills it in the end.

    Its standard output and errors are pipes.
    """
    popen = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **popen}
    process = subprocess.Popen(command(name, *arguments, hears=hears), text=True, **popen)
    try:
        with killed(process):
            yield process
    finally:
        if process.returncode == NEVER_TOLD:
            raise NeverTold(f"the middleware did not tell {name} the name of a node")


def ended(name, *arguments, **how):
    """
    Run one of the programs to its end: exit status, standard output and errors.

    It has its own deadlines, which begin when it has started; the limit of the test ends one that hangs.
    """
    with running(name, *arguments, **how) as process:
        out, err = process.communicate()
    return process.returncode, out, err


@contextmanager
def broadcasting():
    """Run `programs/broadcasts_robot.py` during a `with` statement, from when it has its publishers."""
    with start(PROGRAMS / "broadcasts_robot.py", stdout=subprocess.PIPE) as process:
        try:
            process.stdout.readline()
            yield process
        finally:
            end(process)
