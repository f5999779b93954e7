"""Check that the machine has the tools that the build needs."""

import importlib
import os
import re
import shlex
import shutil
import sys
import sysconfig
from pathlib import Path


def missing_tools(environ=os.environ):
    """List what the build needs and pip cannot install, with advice, one line each."""
    missing = []
    if os.name != "posix":
        missing.append("no POSIX system: use Linux, or WSL on Windows")
    command = environ.get("CC") or sysconfig.get_config_var("CC") or "gcc"
    program = shlex.split(command)[0]
    if not shutil.which(program, path=environ.get("PATH")):
        missing.append(f"no C compiler ({program}): install gcc")
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
