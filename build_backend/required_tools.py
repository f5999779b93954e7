# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Check that the machine has the tools that the build needs.

`python3 build_backend/required_tools.py wheels`, which make runs first, also looks for what a virtual
environment and the messages for ROS's wheels need, and prints one line for each tool that is missing.
"""

import importlib.util
import os
import re
import shlex
import shutil
import sys
import sysconfig
from pathlib import Path

COMPILERS = (("C", "CC", "gcc"), ("C++", "CXX", "g++"))


def missing_tools(environ=os.environ, compilers=COMPILERS[:1]):
    """List what the build needs and pip cannot install, with advice, one line each."""
    missing = []
    if os.name != "posix":
        missing.append("no POSIX system: use Linux, or WSL on Windows")
    for language, variable, package in compilers:
        command = environ.get(variable) or sysconfig.get_config_var(variable) or package
        program = shlex.split(command)[0]
        if not shutil.which(program, path=environ.get("PATH")):
            missing.append(f"no {language} compiler ({program}): install {package}")
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        missing.append("no headers of this Python: install its development package, python3-dev on Debian")
    return missing


def refuse_other_cython():
    """End the build if the right Cython is missing, because colcon, unlike pip, does not install it."""
    try:
        version = importlib.import_module("Cython").__version__
    except ImportError:
        version = None
    # The oldest one is Ubuntu 24.04's.
    if version is None or not (3, 0, 8) <= _release(version) < (3, 3):
        found = f"has {version}" if version else "has none"
        raise SystemExit(
            f"tf2-ros-cython needs Cython 3.0.8 to 3.2, and {sys.executable} {found}: with that Python,"
            " pip install 'Cython>=3.0.8,<3.3', or install cython3 of Ubuntu 24.04 or newer"
        )


def _release(version):
    return tuple(int(number) for number in re.findall(r"\d+", version)[:3])


def refuse_incomplete(environ=os.environ):
    """If a tool is missing, end the build with a message that pip shows, without a traceback."""
    missing = missing_tools(environ)
    if missing:
        raise SystemExit("tf2-ros-cython cannot be built here: " + "; ".join(missing))


def main(kind):
    """Print what is missing for a checkout's environment: of ROS's "wheels", or beside a "sourced" ROS 2."""
    missing = missing_tools(compilers=COMPILERS if kind == "wheels" else COMPILERS[:1])
    if sys.version_info < (3, 10):  # noqa: UP036  no pip has looked at requires-python yet
        number = ".".join(map(str, sys.version_info[:2]))
        missing.insert(0, f"Python {number} is too old: make PYTHON=/path/to/one from 3.10 on")
    if importlib.util.find_spec("ensurepip") is None:
        missing.append("no pip for a virtual environment: install python3-venv")
    if missing:
        missing.append("On Debian and Ubuntu: sudo apt install make g++ python3-dev python3-venv")
        print(*missing, sep="\n")
    return bool(missing)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
