# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Make a Python whose nodes use Cyclone DDS, on Debian 12: `.venv/bin/python -m release.cyclonedds`.

PyPI has no `rmw_cyclonedds_cpp`. This compiles Jazzy's from its published source, with the headers of the
ROS wheels of `.venv` and with Debian's Cyclone DDS, and writes `build/cyclonedds/python`, which runs the
Python of `.venv` with it. `make prove` runs the tests of nodes with that.
"""

import argparse
import subprocess
import sys
from pathlib import Path

from release.unpacking_debs import unpack

ROOT = Path(__file__).resolve().parent.parent
PYTHON = Path("build", "cyclonedds", "python")
SOURCE = "https://github.com/ros2/rmw_cyclonedds.git"
COMMIT = "2ec6f21c2959ee9f5c12ad4a16ad73e1ae0c472b"  # of its branch jazzy
RMW = "-DRMW_VERSION_MAJOR=7 -DRMW_VERSION_MINOR=3 -DRMW_VERSION_PATCH=2"  # of the wheel ros-rmw
DEBS = ["cyclonedds-dev", "libddsc0debian"]
DEBS += [f"libiceoryx-{part}" for part in ("binding-c-dev", "posh-dev", "hoofs-dev")]
DEBS += [f"libiceoryx-{part}2" for part in ("binding-c", "posh", "hoofs", "platform")]
LINKED = (
    "rmw rmw_dds_common rmw_dds_common__rosidl_typesupport_cpp rcutils rcpputils rosidl_runtime_c tracetools"
)
LINKED += " rosidl_typesupport_introspection_c rosidl_typesupport_introspection_cpp ddsc iceoryx_binding_c"
# The wheels' rcl is linked with Fast DDS, whose functions those that are loaded before replace.
SITE = """import ctypes
import os

if os.environ.get("_ROS_WHEELS_BOOTSTRAP_COMPLETE"):
    ctypes.CDLL({library!r}, mode=ctypes.RTLD_GLOBAL | os.RTLD_NOW)
"""
RUN = """#!/bin/sh
unset _ROS_WHEELS_BOOTSTRAP_COMPLETE LD_LIBRARY_PATH
export RMW_IMPLEMENTATION=rmw_cyclonedds_cpp PYTHONPATH={site}${{PYTHONPATH:+:$PYTHONPATH}}
exec .venv/bin/python "$@"
"""


def main(arguments=None):
    parser = argparse.ArgumentParser(
        prog="python -m release.cyclonedds", description=__doc__.strip().splitlines()[0]
    )
    parser.add_argument("--source", default=SOURCE, help="a clone of rmw_cyclonedds; default: %(default)s")
    options = parser.parse_args(arguments)
    folder = (ROOT / PYTHON).parent
    library = _compiled(folder, options.source)
    (folder / "site").mkdir(exist_ok=True)
    (folder / "site" / "sitecustomize.py").write_text(SITE.format(library=str(library)))
    (ROOT / PYTHON).write_text(RUN.format(site=folder / "site"))
    (ROOT / PYTHON).chmod(0o755)
    print(f"{PYTHON} runs .venv/bin/python with Cyclone DDS, in the root of any checkout")


def _compiled(folder, source):
    root = unpack(folder / "debian", DEBS)
    headers = [
        root / "usr" / "include",
        *root.glob("usr/include/*-linux-gnu"),
        *root.glob("usr/include/iceoryx/*"),
    ]
    [debian] = root.glob("usr/lib/*-linux-gnu")
    # Where libddsc looks for the others.
    if not (root / "usr" / "lib" / "lib").exists():
        (root / "usr" / "lib" / "lib").symlink_to(".")
    clone = folder / "rmw_cyclonedds"
    if not clone.exists():
        subprocess.run(["git", "clone", "--quiet", "--branch=jazzy", source, clone], check=True)
    subprocess.run(["git", "checkout", "--quiet", COMMIT], cwd=clone, check=True)
    wheels = Path(sys.prefix)
    library = folder / "librmw_cyclonedds_cpp.so"
    command = ["g++", "-std=c++17", "-shared", "-fPIC", "-O1", "-DNDEBUG", "-w", *RMW.split(), "-o", library]
    command += [f"-I{header}" for header in (*headers, *(wheels / "include").iterdir())]
    command += sorted((clone / "rmw_cyclonedds_cpp" / "src").glob("*.cpp"))
    command += [f"-L{debian}", f"-L{wheels / 'lib'}", *(f"-l{name}" for name in LINKED.split())]
    # Also for the libraries that these need.
    subprocess.run([*command, f"-Wl,-rpath,{debian},--disable-new-dtags"], check=True)
    return library


if __name__ == "__main__":
    main()
