# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""List the libraries to measure: ours, and each of the others that can be had here."""

from __future__ import annotations

import importlib.metadata
import os
import shutil
import subprocess
import sys
import sysconfig
import xml.etree.ElementTree
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from release.child_environment import environment_of_children

ROOT = Path(__file__).resolve().parents[1]
FETCHED = ROOT / ".bench"
PROGRAMS = Path(__file__).resolve().parent / "programs"
OURS = "ours"

SOURCE = "https://github.com/ros2-gbp/geometry2-release.git"
JAZZY = "0.36.20"  # its tf2
TRANSFORM_TREE = "0.0.9"


class Missing(Exception):
    """A library cannot be had here."""


@dataclass
class Library:
    """A library to measure: how its processes are started, and what it is called."""

    key: str
    title: str
    note: str
    python: str = sys.executable
    environment: dict[str, str] = field(default_factory=dict)


def ours() -> Library:
    # Before the packages of a sourced ROS 2, which have the same names.
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    title = f"tf2-ros-cython {importlib.metadata.version('tf2-ros-cython')}"
    return Library(OURS, title, "returns a geometry_msgs/TransformStamped", environment={"PYTHONPATH": path})


def libraries(say: Callable[[str], None]) -> tuple[dict[str, Library], dict[str, str]]:
    """Every library that can be had here, and why the others are missing."""
    found, missing = {OURS: ours()}, {}
    sources: dict[str, Callable[[], Iterator[Library]]] = {
        "tf2": _of_ros2 if os.environ.get("AMENT_PREFIX_PATH") else _from_source,
        "transform-tree": _from_pypi,
    }
    for title, fetch in sources.items():
        say(f"looking for {title}")
        try:
            for library in fetch():
                found[library.key] = library
        except (Missing, OSError, subprocess.CalledProcessError) as error:
            missing[title] = last_line(getattr(error, "stderr", "") or str(error))
    return found, missing


def last_line(text: str) -> str:
    return ([line for line in text.splitlines() if line.strip()] or ["no message"])[-1]


def _of_ros2() -> Iterator[Library]:
    """The tf2 of the sourced ROS 2."""
    prefixes = [Path(prefix) for prefix in os.environ["AMENT_PREFIX_PATH"].split(os.pathsep) if prefix]
    for prefix in prefixes:
        manifest = prefix / "share" / "tf2" / "package.xml"
        if manifest.exists():
            version = xml.etree.ElementTree.parse(manifest).findtext("version")
            break
    else:
        raise Missing("the sourced ROS 2 has no tf2")
    headers = [folder for prefix in prefixes for folder in (prefix / "include").glob("*")]
    library = FETCHED / "libtf2_sourced.so"
    _compile(
        library, [PROGRAMS / "tf2_cpp.cpp"], headers, [prefix / "lib" for prefix in prefixes], "tf2 rcutils"
    )
    yield Library(
        "tf2_cpp", f"tf2 {version} C++", "of the sourced ROS 2", environment={"TF2_CPP": str(library)}
    )
    # Not this environment's Python: it would find our packages of the same names.
    path = os.environ["PATH"].split(os.pathsep)
    beside = os.pathsep.join(folder for folder in path if not folder.startswith(sys.prefix))
    python = shutil.which("python3", path=beside)
    if python is None:
        raise Missing("no python3 beside this one")
    _run(python, "-c", "import tf2_ros", cwd="/")
    yield Library("ros2", f"tf2_ros {version}", "of the sourced ROS 2, in Python", python)


def _from_source() -> Iterator[Library]:
    """Jazzy's tf2, compiled here for the ROS wheels of this environment."""
    wheels = Path(sys.prefix)
    headers = [*(wheels / "include").glob("*")]
    if not (wheels / "include" / "rcutils").exists():
        raise Missing("this environment has no ROS wheels")
    folder = FETCHED / f"tf2-{JAZZY}"
    for package in ("tf2", "tf2_py", "tf2_ros_py", "tf2_geometry_msgs"):
        if not (folder / package).exists():
            tag = f"release/jazzy/{package}/{JAZZY}-1"
            _run("git", "clone", "--quiet", "--depth=1", f"--branch={tag}", SOURCE, str(folder / package))
    headers += [folder / "tf2" / "include", Path(sysconfig.get_paths()["include"])]
    places = [folder, wheels / "lib"]
    bound = folder / "tf2_py"
    extension = bound / "tf2_py" / f"_tf2_py{sysconfig.get_config_var('EXT_SUFFIX')}"
    if not extension.exists():
        _compile(folder / "libtf2.so", [*(folder / "tf2" / "src").glob("*.cpp")], headers, places, "rcutils")
        _compile(extension, [bound / "src" / "tf2_py.cpp"], headers, places, "tf2 rcutils")
    looping = folder / "libtf2_looping.so"
    _compile(looping, [PROGRAMS / "tf2_cpp.cpp"], headers, places, "tf2 rcutils")
    note = "compiled from its published source with -O3"
    yield Library("tf2_cpp", f"tf2 {JAZZY} C++", note, environment={"TF2_CPP": str(looping)})
    path = os.pathsep.join(map(str, (bound, folder / "tf2_ros_py", folder / "tf2_geometry_msgs" / "src")))
    yield Library("ros2", f"tf2_ros {JAZZY}", "the same, in Python", environment={"PYTHONPATH": path})


def _compile(
    library: Path, sources: list[Path], headers: list[Path], places: list[Path], linked: str
) -> None:
    """Compile a shared library from sources, and link others, which are in these places."""
    library.parent.mkdir(parents=True, exist_ok=True)
    flags = ["-std=c++17", "-O3", "-DNDEBUG", "-shared", "-fPIC"]
    flags += [word for folder in headers for word in ("-isystem", str(folder))]
    # Not -Wl,-rpath alone: what the libraries need is found by the old kind of path only.
    ways = [f"-L{folder}" for folder in places] + ["-Wl,--disable-new-dtags"]
    ways += [f"-Wl,-rpath,{folder}" for folder in places]
    names = [f"-l{name}" for name in linked.split()]
    _run("g++", *flags, "-o", str(library), *map(str, sources), *ways, *names)


def _from_pypi() -> Iterator[Library]:
    folder = FETCHED / "beside"
    if not (folder / f"transform_tree-{TRANSFORM_TREE}.dist-info").exists():
        package = f"transform-tree=={TRANSFORM_TREE}"
        _run(sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(folder), package)
    note = "Rust; returns a 4×4 array, of a compiled plan or by names; its latest transform takes "
    note += "the newest sample of each link, not those at the newest common time"
    title = f"transform-tree {TRANSFORM_TREE}"
    yield Library("tf_tree", title, note, environment={"PYTHONPATH": str(folder)})


def _run(*command: str, cwd: str | None = None) -> None:
    environment = environment_of_children()
    subprocess.run(command, cwd=cwd, env=environment, check=True, capture_output=True, text=True)
