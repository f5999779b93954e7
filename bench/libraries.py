# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""List the libraries to measure: ours, and each of the others that can be had here."""

from __future__ import annotations

import importlib.metadata
import os
import shutil
import subprocess
import sys
import xml.etree.ElementTree
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from release import unpacking_debs
from release.child_environment import environment_of_children

ROOT = Path(__file__).resolve().parents[1]
FETCHED = ROOT / ".bench"
PROGRAMS = Path(__file__).resolve().parent / "programs"
OURS = "ours"

DEBIAN_PACKAGES = """
    libtf2-2d libtf2-dev librostime1d libcpp-common0d libroscpp-serialization0d libroscpp-core-dev
    libconsole-bridge1.0 libgeometry-msgs-dev libstd-msgs-dev libboost1.74-dev
""".split()
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
        "tf2 of a sourced ROS 2": _of_ros2,
        "Debian's tf2 for C++, of ROS 1": _from_debian,
        "transform-tree": _from_pypi,
    }
    for title, fetch in sources.items():
        if fetch is _from_debian and "tf2_cpp" in found:
            continue  # it is measured only where ROS 2's is not at hand
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
    prefixes = [
        Path(prefix) for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix
    ]
    if not prefixes:
        raise Missing("no ROS 2 is sourced")
    for prefix in prefixes:
        manifest = prefix / "share" / "tf2" / "package.xml"
        if manifest.exists():
            version = xml.etree.ElementTree.parse(manifest).findtext("version")
            break
    else:
        raise Missing("the sourced ROS 2 has no tf2")
    folders = [folder for prefix in prefixes for folder in (prefix / "include").glob("*")]
    library = _compile("ros2", folders, [prefix / "lib" for prefix in prefixes], ["-ltf2", "-lrcutils"])
    yield Library("tf2_cpp", f"tf2 {version} C++", "of the sourced ROS 2", environment={"TF2_CPP": library})
    # Not this environment's Python: it would find our packages of the same names.
    path = os.environ["PATH"].split(os.pathsep)
    beside = os.pathsep.join(folder for folder in path if not folder.startswith(sys.prefix))
    python = shutil.which("python3", path=beside)
    if python is None:
        raise Missing("no python3 beside this one")
    _run(python, "-c", "import tf2_ros", cwd="/")
    yield Library("ros2", f"tf2_ros {version}", "of the sourced ROS 2, in Python", python)


def _from_debian() -> Iterator[Library]:
    folder = FETCHED / "debian"
    root = unpacking_debs.unpack(folder, DEBIAN_PACKAGES)
    (binaries,) = {path.parent for path in root.glob("usr/lib/*/libtf2.so")}
    (tf2,) = folder.glob("archives/libtf2-2d_*.deb")
    version = tf2.name.split("_")[1].split("-")[0]
    linked = ["-ltf2", "-lrostime", "-lcpp_common", str(next(binaries.glob("libconsole_bridge.so*")))]
    library = _compile("ros1", [root / "usr/include"], [binaries], linked, "-DROS1")
    note = "of ROS 1, from Debian; searches histories by bisection"
    yield Library("tf2_cpp", f"tf2 {version} C++ (ROS 1)", note, environment={"TF2_CPP": library})


def _compile(name: str, headers: list[Path], binaries: list[Path], linked: list[str], *options: str) -> str:
    FETCHED.mkdir(exist_ok=True)
    source, library = PROGRAMS / "tf2_cpp.cpp", FETCHED / f"libtf2_{name}.so"
    places = [word for folder in headers for word in ("-isystem", str(folder))]
    # Not -Wl,-rpath alone: what the libraries need is found by the old kind of path only.
    places += [f"-L{folder}" for folder in binaries] + ["-Wl,--disable-new-dtags"]
    places += [f"-Wl,-rpath,{folder}" for folder in binaries]
    flags = ["-std=c++17", "-O3", "-DNDEBUG", "-shared", "-fPIC", *options]
    _run("g++", *flags, "-o", str(library), str(source), *places, *linked)
    return str(library)


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
