# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Check that the machine has the tools that the build needs."""

import os
import shlex
import shutil
import sysconfig
from pathlib import Path


def refuse_incomplete(environ=os.environ):
    """End the build with a message that pip shows, and no traceback, where a tool is missing."""
    missing = []
    # The type support of Fast DDS is C++; everything else is C.
    for language, variable, package in (("C", "CC", "gcc"), ("C++", "CXX", "g++")):
        command = environ.get(variable) or sysconfig.get_config_var(variable) or package
        program = shlex.split(command)[0]
        if not shutil.which(program, path=environ.get("PATH")):
            missing.append(f"no {language} compiler ({program}): install {package}")
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        missing.append("no headers of this Python: install its development package, python3-dev on Debian")
    if missing:
        raise SystemExit("tf2_msgs cannot be built here: " + "; ".join(missing))
