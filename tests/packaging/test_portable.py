"""
The C of all but the receiver and shared memory: of C11 and POSIX.1-2008, and of no one's kernel or C library.

The receiver is where ROS is, and buffers are shared on Linux; buffers and recordings are everywhere.
"""

import os
import shlex
import shutil
import subprocess
import sysconfig
from concurrent.futures import ThreadPoolExecutor

import Cython
import numpy
import pytest
from paths import ROOT
from sources import extensions

pytestmark = [pytest.mark.ours, pytest.mark.long("compiles all extensions")]

# C's atexit does not pass on the exit status; where the C library has nothing else, it does without.
OF_GLIBC = {"tf2_ros._rcl"}
OF_LINUX = {"tf2_ros._shared.ring"}
PORTABLE = sorted({*extensions()} - OF_GLIBC - OF_LINUX)


def generated(name):
    """The C that Cython made of a module, for the build in place."""
    path = ROOT / "build" / f"cython-{Cython.__version__}" / f"{name.replace('.', '/')}.c"
    if not path.is_file():
        pytest.skip("the extensions were not built in place by this Cython")
    return path


def compiler():
    command = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc")
    if shutil.which(command[0]) is None:
        pytest.skip(f"there is no {command[0]}")
    return command


def test_it_compiles_where_headers_offer_posix_alone(tmp_path):
    # Headers heed the wish for the names of POSIX once: what Python's headers then ask for comes too late.
    first = tmp_path / "posix_alone.h"
    first.write_text("#define _POSIX_C_SOURCE 200809L\n#include <stdlib.h>\n#undef _POSIX_C_SOURCE\n")
    command = [*compiler(), "-fsyntax-only", "-std=c11", "-Werror=implicit-function-declaration"]
    command += ["-include", str(first), f"-I{sysconfig.get_path('include')}", f"-I{numpy.get_include()}"]

    def compiled(path):
        return subprocess.run([*command, path], text=True, capture_output=True)

    with ThreadPoolExecutor(os.cpu_count()) as several:
        ended = [*several.map(compiled, map(generated, PORTABLE))]
    assert [one.stderr for one in ended if one.returncode] == []
