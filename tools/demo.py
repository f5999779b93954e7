"""
Inspect a recording of a robot that drives in a circle: `make -C tools demo`.

Lists the contents of the recording, plots the path of the robot, and reports problems.
"""

import shlex
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
PICTURE = "build/path.png"

COMMANDS = {
    "Contents": "info docs/samples/faults",
    "Path of the robot": f"plot docs/samples/faults --path map base_link -o {PICTURE}",
    "Problems": "check docs/samples/faults",
}
# The exit status by command; `check` exits with 1 if there are problems.
STATUS = {"check": 1}


def main() -> int:
    (HERE / PICTURE).parent.mkdir(exist_ok=True)
    for title, line in COMMANDS.items():
        print(f"\n{title}:\n$ tf2_bag {line}", flush=True)
        command = [sys.executable, "-m", "tf2_ros_tools.programs.tf2_bag", *shlex.split(line)]
        status = subprocess.run(command, cwd=HERE).returncode
        if status != STATUS.get(line.split()[0], 0):
            return 1
    print(f"\nThe picture is {HERE / PICTURE}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
