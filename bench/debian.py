"""Owns fetching Debian's ROS 1 tf2, C++ and Python, and unpacking it without installing it."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

from bench.processes import CONTESTANTS, Failure, Library

PACKAGES = """
    libtf2-2d libtf2-dev librostime1d libcpp-common0d libroscpp-serialization0d libroscpp-core-dev
    libconsole-bridge1.0 libgeometry-msgs-dev libstd-msgs-dev libboost1.74-dev python3-tf2
    python3-geometry-msgs python3-std-msgs python3-genpy python3-genmsg python3-rospy python3-roslib
    python3-rosgraph python3-rosgraph-msgs python3-roscpp-msg python3-rospkg python3-catkin
    python3-catkin-pkg python3-yaml
""".split()
PYTHON = "/usr/bin/python3"  # the one that the packages' extensions are built for
COMPILER = "g++"
COMMAND_S = 300


def libraries(folder: Path) -> list[Library]:
    """tf2 for C++ and for Python; Failure says why they cannot be had."""
    for program in ("apt-get", "dpkg", COMPILER, PYTHON):
        if shutil.which(program) is None:
            raise Failure(f"needs {program}")
    root = folder / "root"
    if not (folder / "unpacked").exists():
        _fetch(folder)
        for package in sorted(folder.glob("*.deb")):
            _run("dpkg", "-x", str(package), str(root))
        (folder / "unpacked").touch()
    (library_folder,) = {path.parent for path in root.glob("usr/lib/*/libtf2.so")}
    (tf2,) = folder.glob("libtf2-2d_*.deb")
    environment = {
        "LD_LIBRARY_PATH": str(library_folder),
        "BENCH_VERSION": tf2.name.split("_")[1].split("-")[0],
    }
    python = {"PYTHONPATH": str(root / "usr/lib/python3/dist-packages"), "PYTHONNOUSERSITE": "1"}
    return [
        Library(
            "ros1_cpp",
            "Debian tf2 C++",
            [PYTHON, str(CONTESTANTS / "ros1_cpp.py"), str(_compile(folder, root, library_folder))],
            ("core",),
            environment,
            note="BufferCore::lookupTransform, returns a C++ message; histories are searched in halves",
        ),
        Library(
            "ros1_py",
            "Debian tf2_py",
            [PYTHON, str(CONTESTANTS / "ros1_py.py")],
            ("core",),
            {**environment, **python},
            note="lookup_transform_core, returns a message; the same engine",
        ),
    ]


def _fetch(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    download = ["apt-get", "-qq", "download", *PACKAGES]
    try:
        _run(*download, cwd=folder)
    except Failure:
        # Containers come without package lists: keep lists of our own, the system's stay as they are.
        state, cache = folder / "state", folder / "cache"
        for place in (state / "lists/partial", cache / "archives/partial"):
            place.mkdir(parents=True, exist_ok=True)
        options = ["-o", f"Dir::State::Lists={state / 'lists'}", "-o", f"Dir::Cache={cache}"]
        _run("apt-get", "-qq", *options, "update")
        _run(download[0], *options, *download[1:], cwd=folder)


def _compile(folder: Path, root: Path, library_folder: Path) -> Path:
    source, program = CONTESTANTS / "ros1_cpp.cpp", folder / "libros1_cpp.so"
    if not program.exists() or program.stat().st_mtime < source.stat().st_mtime:
        print("  compiling the C++ loop ...", file=sys.stderr, flush=True)
        _run(
            COMPILER,
            "-std=c++17",
            "-O3",
            "-DNDEBUG",
            "-shared",
            "-fPIC",
            "-o",
            str(program),
            str(source),
            "-isystem",
            str(root / "usr/include"),
            f"-L{library_folder}",
            f"-Wl,-rpath-link,{library_folder}",
            "-ltf2",
            "-lrostime",
            "-lcpp_common",
            str(next(library_folder.glob("libconsole_bridge.so*"))),
        )
    return program


def _run(*command: str, cwd: Path | None = None) -> None:
    try:
        subprocess.run(command, cwd=cwd, check=True, capture_output=True, text=True, timeout=COMMAND_S)
    except subprocess.CalledProcessError as error:
        lines = [line for line in error.stderr.splitlines() if line.strip()] or ["no word"]
        raise Failure(f"{command[0]} failed: {lines[-1]}") from None
    except subprocess.TimeoutExpired:
        raise Failure(f"{command[0]} took longer than {COMMAND_S} s") from None
