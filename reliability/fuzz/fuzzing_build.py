# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Build what fuzzing needs: the extensions with coverage and sanitizers, and atheris."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from reliability import flagged_builds

ATHERIS = "atheris==3.0.0"
SANITIZERS = "-fsanitize=fuzzer-no-link,address,undefined"
CFLAGS = [
    SANITIZERS,
    "-fno-sanitize-recover=undefined",
    "-fno-omit-frame-pointer",
    "-g1",
]
# Any that knows these sanitizers will do: libFuzzer and the runtimes are those of atheris.
CLANGS = ["clang", *(f"clang-{version}" for version in range(21, 13, -1))]


def built() -> Path:
    """
    Bring the copy of the checkout with instrumented extensions up to date; return its path.

    :raises SystemExit: there is no clang, or no atheris for this Python.
    """
    clang = next(filter(None, map(shutil.which, CLANGS)), None)
    if clang is None:
        raise SystemExit("fuzzing needs clang 14 or newer: apt-get install clang-14")
    runtime = _runtime()
    # Among the libraries to link with, for a build that allows no undefined symbols.
    return flagged_builds.build(
        "fuzz",
        cflags=CFLAGS,
        ldflags=[SANITIZERS, str(runtime)],
        CC=clang,
        CXX=clang.replace("clang", "clang++"),
    )


def environment(build: Path, *, guarded: bool = True) -> dict[str, str]:
    """
    That of a process which fuzzes.

    :param guarded: Python's own objects have memory of their own, too: slower, but otherwise they share
        blocks, in which no sanitizer sees where one ends.
    """
    # A Python with the ROS wheels leaves the first two to its children, which would not find their libraries.
    left_out = {"_ROS_WHEELS_BOOTSTRAP_COMPLETE", "LD_LIBRARY_PATH", "PYTHONPATH"}
    return {
        **{name: value for name, value in os.environ.items() if name not in left_out},
        "PYTHONPATH": os.pathsep.join([str(build), str(build / "tools"), str(_atheris())]),
        "LD_PRELOAD": str(_runtime()),
        "PYTHONMALLOC": "malloc" if guarded else "default",
        # Python itself leaks what lives as long as it. Memory that there is not is a MemoryError. Short
        # stacks of allocations are quicker.
        "ASAN_OPTIONS": "detect_leaks=0:allocator_may_return_null=1:max_allocation_size_mb=512"
        ":malloc_context_size=3:quarantine_size_mb=32",
        "UBSAN_OPTIONS": "print_stacktrace=1",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }


def _atheris() -> Path:
    # Beside the environment, not in it: it has no dependencies, and nothing else needs it.
    return flagged_builds.BUILDS / "atheris"


def _runtime() -> Path:
    runtime = _atheris() / "asan_with_fuzzer.so"
    if not runtime.exists():
        command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--only-binary", ":all:"]
        found = subprocess.run([*command, "--target", str(_atheris()), ATHERIS])
        if found.returncode != 0:
            raise SystemExit(f"fuzzing needs {ATHERIS}, whose wheels are for Python 3.11 to 3.13")
    return runtime
