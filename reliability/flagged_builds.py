# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Build copies of the checkout with other flags; its own build stays as it is."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BUILDS = ROOT / ".reliability"


def in_processes(per_core):
    """Options of pytest to run the files of a suite in so many processes for each core, at most eight."""
    count = min(per_core * len(os.sched_getaffinity(0)), 8)
    return (f"--numprocesses={count}", "--dist=loadfile", "--no-loadscope-reorder", "--max-worker-restart=0")


def build(name, *, cflags=(), ldflags=(), **variables):
    """
    Bring ``.reliability/<name>`` up to date with the checkout and build it in place; return its path.

    :param name: the folder's name. Each set of flags needs a name of its own.
    :param cflags: added to Python's own flags, for the compiler; ``ldflags``, for the linker.
    :param variables: more of the environment of the build, as ``CC="clang"``.
    :raises subprocess.CalledProcessError: the build failed; ``build.log`` of the folder has what was printed.
    """
    folder = BUILDS / name
    options = json.dumps([list(cflags), list(ldflags), sys.executable, variables], indent=1)
    kept = folder / "options.json"
    if folder.exists() and (not kept.exists() or kept.read_text() != options):
        # setuptools compares ages, and knows nothing of flags.
        shutil.rmtree(folder)
    folder.mkdir(parents=True, exist_ok=True)
    _copy(folder)
    environment = {
        **os.environ,
        "CFLAGS": " ".join(cflags),
        "LDFLAGS": " ".join(ldflags),
        **variables,
    }
    environment.pop("PYTHONPATH", None)
    with open(folder / "build.log", "w") as log:
        command = [sys.executable, "setup.py", "build_ext", "--inplace"]
        subprocess.run(command, cwd=folder, env=environment, stdout=log, stderr=log, check=True)
    kept.write_text(options)
    return folder


def _copy(folder):
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")
    wanted = {name for name in names if name and (ROOT / name).is_file()}
    # What Cython made of the same sources need not be made again: it compares ages, which a copy keeps.
    for made in (ROOT / "build").glob("cython-*/**/*.c"):
        wanted.add(made.relative_to(ROOT).as_posix())
    for name in wanted:
        source, copy = ROOT / name, folder / name
        if not copy.exists() or copy.stat().st_mtime < source.stat().st_mtime:
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, copy)
    for copy in folder.rglob("*.py*"):
        name = copy.relative_to(folder).as_posix()
        if copy.suffix in {".py", ".pyx", ".pxd", ".pxi", ".pyi"} and name not in wanted and _is_source(name):
            copy.unlink()


def _is_source(name):
    return not name.startswith("build/") and name != "tf2_ros_cython/_built.py"
