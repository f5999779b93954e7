"""
Run tests beside a busy machine, several times in a row; none may fail: `make endure`.

The load: four processes that compute, one that writes files through the disk cache, and a ROS 2 system of
twenty nodes in another domain. The parts: the tests of nodes (`ros`), of the commands (`programs`) and of
installations (`packaging`), and `.ci/run` or some of its steps in a new clone of the last commit (`gate`).
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
            start("-m", "reliability.busy_robot", str(number), str(NODES))
        yield


def command_of(part, clone):
    """What a part runs each time: the folder and the command."""
    if part == "gate":
        subprocess.run(["git", "clone", "--quiet", str(ROOT), clone], check=True)
        shared = ROOT.parent / "shared"
        if shared.exists():
            Path(clone.parent, "shared").symlink_to(shared)
        return clone, ["bash", ".ci/run"]
    folder, tests = SUITES[part]
    pytest = ["-m", "pytest", "-q", "-p", "no:cacheprovider", f"--numprocesses={2 * os.cpu_count()}"]
    pytest += ["--dist=loadfile", "--no-loadscope-reorder", "--max-worker-restart=0", "--all"]
    return folder, [sys.executable, *pytest, tests]


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
    parser.add_argument("part", choices=[*SUITES, "gate"])
    parser.add_argument("--times", type=int, default=5, help="how often in a row (default: 5)")
    parser.add_argument("--alone", action="store_true", help="without the load")
    parser.add_argument("further", nargs="*", help="further arguments of pytest, or the steps of the gate")
    options = parser.parse_intermixed_args(arguments)
    print(f"the ROS 2 system of the load uses domain {use_own_domain()}", flush=True)
    ends = []
    with ExitStack() as stack:
        if not options.alone:
            stack.enter_context(load())
        for number in range(1, options.times + 1):
            with tempfile.TemporaryDirectory(prefix="tf2-ros-cython-gate-") as place:
                folder, command = command_of(options.part, Path(place, "clone"))
                begin = time.monotonic()
                status = run([*command, *options.further], folder)
            ends.append(status)
            took_s = time.monotonic() - begin
            print(
                f"== {options.part} {number}: exit status {status} after {took_s:.0f} s",
                flush=True,
            )
    return 1 if any(ends) else 0


if __name__ == "__main__":
    sys.exit(main())
