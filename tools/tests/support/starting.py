"""Start the programs of the tools, and those that their tests need."""

import shutil
import subprocess
import sys
from contextlib import contextmanager

import pytest
from places import PROGRAMS
from processes import DEADLINE_S, end, killed, start


def needs_dot(test):
    """Mark a test that runs Graphviz, which `make test` does not install."""
    is_missing = pytest.mark.skipif(shutil.which("dot") is None, reason="Graphviz is not installed")
    return pytest.mark.long("needs Graphviz")(is_missing(test))


def program(name, *arguments, **popen):
    """Start one of the programs; its standard output and errors are pipes."""
    command = [sys.executable, "-m", f"tf2_ros_tools.programs.{name}", *arguments]
    popen = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **popen}
    return subprocess.Popen(command, text=True, **popen)


def running(name, *arguments, **popen):
    """The same for a `with` statement, which kills it in the end."""
    return killed(program(name, *arguments, **popen))


def ended(name, *arguments, **popen):
    """Run one of the programs to its end: exit status, standard output and errors."""
    with running(name, *arguments, **popen) as process:
        out, err = process.communicate(timeout=DEADLINE_S)
    return process.returncode, out, err


@contextmanager
def broadcasting():
    """Run `programs/broadcasting.py` during a `with` statement, from when it has its publishers."""
    with start(PROGRAMS / "broadcasting.py", stdout=subprocess.PIPE) as process:
        try:
            process.stdout.readline()
            yield process
        finally:
            end(process)
