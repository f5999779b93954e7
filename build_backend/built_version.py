# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Record which version was built."""

from pathlib import Path

NAME = Path("tf2_ros_cython", "_built.py")


def write(build_lib, version):
    """Write the note, the project's version, below the folder of what is built, and return its path."""
    path = Path(build_lib, NAME)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f'"""Written by the build."""\n\nVERSION: str = {version!r}\n', encoding="utf-8")
    return path
