"""
Look at a recording of a robot that drives in a circle: `make -C tools demo`.

Prints what is in the recording and what is wrong with it, and draws the path of the robot as a picture.
"""

import shlex
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
PICTURE = "build/path.png"

COMMANDS = {
    "What is in it": "info docs/samples/faults",
    "The path of the robot, as a picture": f"plot docs/samples/faults --path map base_link -o {PICTURE}",
    "What is wrong with it": "check docs/samples/faults",
}
# By the command: the exit status; that of `check` says whether something is wrong.
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
