# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Run tests beside a busy machine, several times in a row; none may fail: `make endure`.

The load: four processes that compute, one that writes files through the disk cache, and a ROS 2 system of
twenty nodes in another domain. The parts: the tests of nodes (`ros`), of the commands (`programs`) and of
installations (`packaging`).
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path

from reliability.flagged_builds import ROOT
from reliability.own_ros_domain import use_own_domain

BUSY_LOOPS = 4
ROBOTS, NODES = 4, 5  # processes, and nodes in each
WRITTEN_BYTES = 4 << 30
CHUNK_BYTES = 16 << 20

PYTEST = f"""
-m pytest -q --all -p no:cacheprovider --numprocesses={2 * os.cpu_count()} --dist=loadfile
--no-loadscope-reorder --max-worker-restart=0
""".split()
# By part: the folder to run pytest in, and its tests.
SUITES = {
    "ros": (ROOT, "tests/ros"),
    "programs": (ROOT / "tools", "tests/programs"),
    "packaging": (ROOT, "tests/packaging"),
}

# Each ends with this process, whose end closes its standard input.
FOLLOW_PARENT = """
import os, sys, threading
threading.Thread(target=lambda: (sys.stdin.read(), os._exit(0))).start()
"""
BUSY = FOLLOW_PARENT + "while True:\n    sum(range(1000))\n"
WRITING = (
    FOLLOW_PARENT
    + f"""
chunk = os.urandom({CHUNK_BYTES})
with open(sys.argv[1], "wb", buffering=0) as file:
    while True:
        file.seek(0)
        for _ in range({WRITTEN_BYTES // CHUNK_BYTES}):
            file.write(chunk)
"""
)


@contextmanager
def load():
    """Keep the machine busy during a `with` statement."""
    with tempfile.TemporaryDirectory(prefix="tf2-ros-cython-endure-") as folder, ExitStack() as started:

        def start(*arguments):
            process = subprocess.Popen([sys.executable, *arguments], stdin=subprocess.PIPE, cwd=ROOT)
            started.enter_context(process)
            started.callback(process.kill)

        for _ in range(BUSY_LOOPS):
            start("-c", BUSY)
        start("-c", WRITING, str(Path(folder, "written")))
        for number in range(ROBOTS):
            start("-m", "reliability.load_nodes", str(number), str(NODES))
        yield


def run(command, folder):
    """Return the exit status of a command. All its processes end with this one."""
    process = subprocess.Popen(command, cwd=folder, start_new_session=True)
    try:
        return process.wait()
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGTERM)
            process.wait()


def main(arguments=None):
    """Return the exit status: 0 if no run failed."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    parser = argparse.ArgumentParser(
        prog="python -m reliability.tests_under_load",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("part", choices=SUITES)
    parser.add_argument("--times", type=int, default=5, help="how often in a row (default: 5)")
    parser.add_argument("further", nargs="*", help="further arguments of pytest")
    options = parser.parse_intermixed_args(arguments)
    print(f"the ROS 2 system of the load uses domain {use_own_domain()}", flush=True)
    (folder, tests), ends = SUITES[options.part], []
    with load():
        for number in range(1, options.times + 1):
            begin = time.monotonic()
            ends.append(run([sys.executable, *PYTEST, tests, *options.further], folder))
            took_s = time.monotonic() - begin
            print(f"== {options.part} {number}: exit status {ends[-1]} after {took_s:.0f} s", flush=True)
    return 1 if any(ends) else 0


if __name__ == "__main__":
    sys.exit(main())
