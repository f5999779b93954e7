"""List the libraries to measure: ours, and every other tf2 available here."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from bench.processes import CONTESTANTS, Failure, Library, run_command
from release import debian

ROOT = Path(__file__).resolve().parents[1]
FETCHED = ROOT / ".bench"

DEBIAN_PACKAGES = """
    libtf2-2d libtf2-dev librostime1d libcpp-common0d libroscpp-serialization0d libroscpp-core-dev
    libconsole-bridge1.0 libgeometry-msgs-dev libstd-msgs-dev libboost1.74-dev
""".split()
COMPILER = "g++"


def ours() -> Library:
    # Before the packages of a sourced ROS 2, which have the same names.
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    command = [sys.executable, str(CONTESTANTS / "ours.py")]
    return Library("ours", "tf2-ros-cython", command, ("buffer", "core"), {"PYTHONPATH": path})


def all_peers(say: Callable[[str], None], only_ros2: bool = False) -> tuple[list[Library], dict[str, str]]:
    """Every peer that can be had here, or only a sourced ROS 2; and why the others are missing."""
    found: list[Library] = []
    missing: dict[str, str] = {}
    sources: dict[str, Callable[[], list[Library]]] = {"tf2_ros of a sourced ROS 2": _sourced_ros2}
    if not only_ros2:
        sources["Debian's ROS 1 tf2 for C++"] = lambda: [_from_debian(FETCHED / "debian")]
    for title, fetch in sources.items():
        say(f"looking for {title}")
        try:
            found += fetch()
        except Failure as failure:
            missing[title] = str(failure)
    return found, missing


def _sourced_ros2() -> list[Library]:
    """The tf2_ros of the environment that this run was started in."""
    if not os.environ.get("AMENT_PREFIX_PATH"):
        raise Failure("no ROS 2 is sourced")
    # Not this environment's Python: it would find our packages of the same names.
    folders = os.environ["PATH"].split(os.pathsep)
    path = os.pathsep.join(folder for folder in folders if not folder.startswith(sys.prefix))
    python = shutil.which("python3", path=path)
    if python is None:
        raise Failure("no python3 beside this one")
    run_command(python, "-c", "import tf2_ros", cwd=Path("/"), seconds=60)
    command = [python, str(CONTESTANTS / "ros2_tf2.py")]
    note = "Buffer.lookup_transform and lookup_transform_core of the sourced ROS 2"
    return [Library("ros2", "ROS 2 tf2_ros", command, ("buffer", "core"), note=note)]


def _from_debian(folder: Path) -> Library:
    """ROS 1's tf2 for C++, unpacked without being installed."""
    if shutil.which(COMPILER) is None:
        raise Failure(f"needs {COMPILER}")
    try:
        root = debian.unpack(folder, DEBIAN_PACKAGES)
    except (OSError, subprocess.CalledProcessError) as error:
        raise Failure(f"{error}\n{getattr(error, 'stderr', '')}") from error
    (library_folder,) = {path.parent for path in root.glob("usr/lib/*/libtf2.so")}
    (tf2,) = folder.glob("archives/libtf2-2d_*.deb")
    environment = {
        "LD_LIBRARY_PATH": str(library_folder),
        "BENCH_VERSION": tf2.name.split("_")[1].split("-")[0],
    }
    command = [sys.executable, str(CONTESTANTS / "ros1_cpp.py"), str(_compile(folder, root, library_folder))]
    note = "BufferCore::lookupTransform, returns a C++ message; searches histories by bisection"
    return Library("ros1_cpp", "Debian tf2 C++", command, ("core",), environment, note=note)


def _compile(folder: Path, root: Path, library_folder: Path) -> Path:
    source, library = CONTESTANTS / "ros1_cpp.cpp", folder / "libros1_cpp.so"
    if not library.exists() or library.stat().st_mtime < source.stat().st_mtime:
        console_bridge = str(next(library_folder.glob("libconsole_bridge.so*")))
        options = ["-std=c++17", "-O3", "-DNDEBUG", "-shared", "-fPIC"]
        folders = ["-isystem", str(root / "usr/include"), f"-L{library_folder}"]
        libraries = ["-ltf2", "-lrostime", "-lcpp_common", console_bridge]
        run_command(COMPILER, *options, "-o", str(library), str(source), *folders, *libraries)
    return library
