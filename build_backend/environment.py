"""Owns what the build asks of the machine: the tools."""

import importlib
import os
import shlex
import shutil
import sys
import sysconfig
from pathlib import Path


def missing_tools(environ=os.environ):
    """One line for each thing that the build needs and pip cannot bring, with what to do about it."""
    missing = missing_of_python()
    command = environ.get("CC") or sysconfig.get_config_var("CC") or "gcc"
    program = shlex.split(command)[0]
    if not shutil.which(program, path=environ.get("PATH")):
        missing.append(f"no C compiler ({program}): install gcc")
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        missing.append("no headers of this Python: install its development package, python3-dev on Debian")
    return missing


def missing_of_python():
    """One line for each thing that this Python, or its system, is not."""
    missing = []
    if sys.implementation.name != "cpython":
        missing.append(f"no CPython: this is {sys.implementation.name}, whose objects are laid out otherwise")
    if sysconfig.get_config_var("Py_GIL_DISABLED"):
        missing.append("no global interpreter lock: use the build of this Python that has it")
    if os.name != "posix":
        missing.append("no POSIX system: use Linux, or WSL on Windows")
    return missing


def refuse_other_cython():
    """End the build where there is not the right Cython: colcon, unlike pip, installs nothing for a build."""
    try:
        version = importlib.import_module("Cython").__version__
    except ImportError:
        version = None
    if version is None or version.split(".")[:2] != ["3", "2"]:
        found = f"has {version}" if version else "has none"
        raise SystemExit(
            f"tf2-ros-cython needs Cython 3.2, and {sys.executable} {found}: with that Python,"
            " pip install --user 'Cython>=3.2,<3.3'"
        )


def refuse_incomplete(environ=os.environ):
    """End the build with a message that pip shows, and no traceback, where a tool is missing."""
    missing = missing_tools(environ)
    if missing:
        raise SystemExit("tf2-ros-cython cannot be built here: " + "; ".join(missing))
