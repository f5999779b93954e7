"""Owns the list of libraries that are measured: ours, and every tf2 and other library available here."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

from bench.processes import CONTESTANTS, Failure, Library, run_command

ROOT = Path(__file__).resolve().parents[1]
FETCHED = ROOT / ".bench"

DEBIAN_PACKAGES = """
    libtf2-2d libtf2-dev librostime1d libcpp-common0d libroscpp-serialization0d libroscpp-core-dev
    libconsole-bridge1.0 libgeometry-msgs-dev libstd-msgs-dev libboost1.74-dev python3-tf2
    python3-geometry-msgs python3-std-msgs python3-genpy python3-genmsg python3-rospy python3-roslib
    python3-rosgraph python3-rosgraph-msgs python3-roscpp-msg python3-rospkg python3-catkin
    python3-catkin-pkg python3-yaml
""".split()
DEBIAN_PYTHON = "/usr/bin/python3"  # the packages' extensions are built for this one
COMPILER = "g++"

NEEDED = ("numpy", "rosbags")  # by from_pypi.py itself
PYPI_PYTHON = (3, 12)  # the oldest that schiebung has wheels for
# package -> key, ways of a single lookup, note
PYPI_PACKAGES = {
    "schiebung": (
        "schiebung",
        ("core",),
        "Rust; returns an object of its own; keeps 120 s; 'latest' takes each link's own newest sample",
    ),
    "transforms-py": (
        "transforms",
        ("core",),
        "Rust; returns a tuple; has no 'latest': the newest common stamp is requested",
    ),
    "pytransform3d": (
        "pytransform3d",
        ("core",),
        "NumPy; returns a 4x4 array; histories are given whole; interpolates along screws",
    ),
    "scipy": (
        "scipy",
        (),
        "Slerp and interp of each link, composed; no tree, no inserts; many times only",
    ),
}


def ours() -> Library:
    # Before the packages of a sourced ROS 2, which have the same names.
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    command = [sys.executable, str(CONTESTANTS / "ours.py")]
    return Library("ours", "tf2-ros-cython", command, ("buffer", "core"), {"PYTHONPATH": path})


def all_peers(say: Callable[[str], None]) -> tuple[list[Library], dict[str, str]]:
    """Every peer that can be had here, and why the others are missing."""
    found: list[Library] = []
    missing: dict[str, str] = {}
    sources: dict[str, Callable[[], list[Library]]] = {
        "tf2_ros of a sourced ROS 2": _sourced_ros2,
        "Debian's ROS 1 tf2, C++ and Python": lambda: _from_debian(FETCHED / "debian"),
    }
    for package in PYPI_PACKAGES:
        sources[package] = lambda package=package: [_from_pypi(FETCHED / "pypi", package)]  # type: ignore[misc]
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


def _from_debian(folder: Path) -> list[Library]:
    """ROS 1's tf2 for C++ and for Python, unpacked without being installed."""
    for program in ("apt-get", "dpkg", COMPILER, DEBIAN_PYTHON):
        if shutil.which(program) is None:
            raise Failure(f"needs {program}")
    root = folder / "root"
    if not (folder / "unpacked").exists():
        _download_from_debian(folder)
        for package in sorted(folder.glob("*.deb")):
            run_command("dpkg", "-x", str(package), str(root))
        (folder / "unpacked").touch()
    (library_folder,) = {path.parent for path in root.glob("usr/lib/*/libtf2.so")}
    (tf2,) = folder.glob("libtf2-2d_*.deb")
    environment = {
        "LD_LIBRARY_PATH": str(library_folder),
        "BENCH_VERSION": tf2.name.split("_")[1].split("-")[0],
    }
    packages = {"PYTHONPATH": str(root / "usr/lib/python3/dist-packages"), "PYTHONNOUSERSITE": "1"}
    cpp = [DEBIAN_PYTHON, str(CONTESTANTS / "ros1_cpp.py"), str(_compile(folder, root, library_folder))]
    python = [DEBIAN_PYTHON, str(CONTESTANTS / "ros1_py.py")]
    return [
        Library(
            "ros1_cpp",
            "Debian tf2 C++",
            cpp,
            ("core",),
            environment,
            note="BufferCore::lookupTransform, returns a C++ message; searches histories by bisection",
        ),
        Library(
            "ros1_py",
            "Debian tf2_py",
            python,
            ("core",),
            {**environment, **packages},
            note="lookup_transform_core, returns a message; the same engine",
        ),
    ]


def _download_from_debian(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    download = ["apt-get", "-qq", "download", *DEBIAN_PACKAGES]
    try:
        run_command(*download, cwd=folder)
    except Failure:
        # Containers come without package lists: keep lists of our own, the system's stay as they are.
        state, cache = folder / "state", folder / "cache"
        for place in (state / "lists/partial", cache / "archives/partial"):
            place.mkdir(parents=True, exist_ok=True)
        options = ["-o", f"Dir::State::Lists={state / 'lists'}", "-o", f"Dir::Cache={cache}"]
        run_command("apt-get", "-qq", *options, "update")
        run_command(download[0], *options, *download[1:], cwd=folder)


def _compile(folder: Path, root: Path, library_folder: Path) -> Path:
    source, library = CONTESTANTS / "ros1_cpp.cpp", folder / "libros1_cpp.so"
    if not library.exists() or library.stat().st_mtime < source.stat().st_mtime:
        console_bridge = str(next(library_folder.glob("libconsole_bridge.so*")))
        options = ["-std=c++17", "-O3", "-DNDEBUG", "-shared", "-fPIC"]
        folders = ["-isystem", str(root / "usr/include"), f"-L{library_folder}"]
        libraries = ["-ltf2", "-lrostime", "-lcpp_common", console_bridge]
        run_command(COMPILER, *options, "-o", str(library), str(source), *folders, *libraries)
    return library


def _from_pypi(folder: Path, package: str) -> Library:
    """One library, installed into an environment that all of them share."""
    key, ways, note = PYPI_PACKAGES[package]
    python = folder / "bin" / "python"
    if not python.exists():
        run_command(_python_for_pypi(), "-m", "venv", str(folder))
    for needed in (*NEEDED, package):
        installed = folder / f"{needed}.installed"
        if not installed.exists():
            # A source package may need a compiler of another language.
            run_command(str(python), "-m", "pip", "install", "--quiet", "--only-binary", ":all:", needed)
            installed.touch()
    # schiebung writes a configuration into its user's home.
    environment = {"HOME": str(folder), "XDG_CONFIG_HOME": str(folder / "config"), "PYTHONPATH": ""}
    command = [str(python), str(CONTESTANTS / "from_pypi.py"), package]
    return Library(key, package, command, ways, environment, note=note)


def _python_for_pypi() -> str:
    """The oldest Python that has wheels of all of them; where there is none, this one."""
    candidates = {shutil.which(f"python3.{minor}") for minor in range(12, 16)} | {sys.executable}
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    candidates |= {str(path) for path in pyenv.glob("versions/*/bin/python3")}
    good = []
    for candidate in filter(None, candidates):
        try:
            words = run_command(
                candidate, "-c", "import ensurepip, sys; print(*sys.version_info[:3])", seconds=20
            ).split()
        except Failure:
            continue
        version = tuple(map(int, words))
        if version >= PYPI_PYTHON:
            good.append((version, candidate))
    return min(good)[1] if good else sys.executable
