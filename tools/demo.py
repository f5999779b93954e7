# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Inspect a recording of a robot that drives in a circle, and listen to a robot: `make -C tools demo`.

Lists the contents of the recording, plots the path of the robot, and reports problems. Then another process
sends transforms over Zenoh, and commands listen to it. Nothing needs ROS 2.
"""

import shlex
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

HERE = Path(__file__).resolve().parent
PICTURE = "build/path.png"

OF_RECORDING = {
    "Contents": "tf2_bag info docs/samples/faults",
    "Path of the robot": f"tf2_bag plot docs/samples/faults --path map base_link -o {PICTURE}",
    "Problems": "tf2_bag check docs/samples/faults",
}
OF_ROBOT = {
    "What a robot sends": "view_frames --text -t 2 --live {where}",
    "Where its camera is": "tf2_echo map camera --once --live {where}",
}
# The exit status by command; `check` exits with 1 if there are problems.
STATUS = {"check": 1}


def run(title: str, line: str) -> None:
    print(f"\n{title}:\n$ {line}", flush=True)
    name, *arguments = shlex.split(line)
    command = [sys.executable, "-m", f"tf2_ros_tools.programs.{name}", *arguments]
    status = subprocess.run(command, cwd=HERE).returncode
    if status != STATUS.get(arguments[0], 0):
        raise SystemExit(1)


@contextmanager
def robot() -> Iterator[str]:
    """A process that sends transforms; yields where to connect to."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    command = [sys.executable, str(HERE / "demo_robot.py"), str(port)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None and process.stdout is not None
        if not process.stdout.readline():
            raise SystemExit(1)
        yield f"zenoh://127.0.0.1:{port}"
        process.stdin.close()


def main() -> None:
    (HERE / PICTURE).parent.mkdir(exist_ok=True)
    for title, line in OF_RECORDING.items():
        run(title, line)
    print(f"\nThe picture is {HERE / PICTURE}")
    with robot() as where:
        for title, line in OF_ROBOT.items():
            run(title, line.format(where=where))


if __name__ == "__main__":
    main()
