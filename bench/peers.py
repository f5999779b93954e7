"""Owns the list of libraries that are measured: ours, and every tf2 and other one that can be had here."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from bench import debian, pypi
from bench.processes import CONTESTANTS, Failure, Library, Process, clean_environment

ROOT = Path(__file__).resolve().parents[1]
FETCHED = ROOT / ".bench"


def ours() -> Library:
    # Before the packages of a sourced ROS 2, which have the same names.
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    return Library(
        "ours",
        "tf2-ros-cython",
        [sys.executable, str(CONTESTANTS / "ours.py")],
        ("buffer", "core"),
        {"PYTHONPATH": path},
    )


def sourced_ros2() -> Library:
    """The tf2_ros of the environment that this run was started in; Failure where there is none."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "")
    if not prefixes:
        raise Failure("no ROS 2 is sourced")
    # Not this environment's Python: it would find our packages of the same names.
    path = os.pathsep.join(
        folder for folder in os.environ["PATH"].split(os.pathsep) if not folder.startswith(sys.prefix)
    )
    python = shutil.which("python3", path=path)
    if python is None:
        raise Failure("no python3 beside this one")
    library = Library(
        "ros2",
        "ROS 2 tf2_ros",
        [python, str(CONTESTANTS / "ros2_tf2.py")],
        ("buffer", "core"),
        note="Buffer.lookup_transform and lookup_transform_core of the sourced ROS 2",
    )
    try:
        subprocess.run(
            [python, "-c", "import tf2_ros"],
            cwd="/",
            check=True,
            capture_output=True,
            timeout=60,
            env=clean_environment(),
        )
    except (OSError, subprocess.SubprocessError):
        raise Failure(f"{python} cannot import tf2_ros") from None
    return library


def all_peers(say: Callable[[str], None]) -> tuple[list[Library], dict[str, str]]:
    """Every peer that starts and tells its version, and why the others are missing."""
    found: list[Library] = []
    missing: dict[str, str] = {}
    try:
        found.append(sourced_ros2())
    except Failure as failure:
        missing["tf2_ros of a sourced ROS 2"] = str(failure)
    say("fetching Debian's tf2")
    try:
        found += debian.libraries(FETCHED / "debian")
    except Failure as failure:
        missing["Debian's ROS 1 tf2, C++ and Python"] = str(failure)
    say("fetching libraries from PyPI")
    try:
        for library in pypi.libraries(FETCHED / "pypi"):
            if isinstance(library, Library):
                found.append(library)
            else:
                missing[library[0]] = library[1]
    except Failure as failure:
        missing["libraries from PyPI"] = str(failure)
    return [library for library in found if _introduced(library, missing)], missing


def _introduced(library: Library, missing: dict[str, str]) -> bool:
    process = Process(library)
    try:
        library.about = process.ask("about", seconds=60)
    except Failure as failure:
        missing[library.title] = str(failure)
        return False
    finally:
        process.end()
    return True
