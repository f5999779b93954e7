# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fuzz one target: `python -m reliability.fuzz.fuzz_one <target> <options of libFuzzer>`."""

import hashlib
import sys
from pathlib import Path

import atheris
from rclpy.logging import LoggingSeverity, set_logger_level

from reliability.fuzz.targets import PACKAGES, target


def main() -> None:
    """Fuzz until libFuzzer's options say that it is enough; it ends the process."""
    name = sys.argv.pop(1)
    with atheris.instrument_imports(include=PACKAGES):
        found = target(name)
    # Each refused transform would be a line.
    for logger in ("tf2_py", "tf2_ros"):
        set_logger_level(logger, LoggingSeverity.FATAL)
    crashes = next(one.partition("=")[2] for one in sys.argv if one.startswith("-artifact_prefix="))

    def run(data: bytes) -> None:
        try:
            found.run(data)
        except BaseException:
            # libFuzzer's own way from here to such a file leads through the end of all libraries of ROS.
            Path(f"{crashes}exception-{hashlib.sha1(data).hexdigest()[:12]}").write_bytes(data)
            raise

    # By this libFuzzer starts itself again, where it compares inputs that may crash it.
    command = f"{sys.executable} -m reliability.fuzz.fuzz_one {name}"
    atheris.Setup([command, *sys.argv[1:]], run)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
