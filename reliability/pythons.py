"""Find the interpreters to repeat a run with, and build for each."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from reliability.builds import BUILDS, ROOT, build

VERSIONS = ("3.10", "3.11", "3.12", "3.13", "3.14")
NEEDED = ("ros-jazzy-rclpy[fastrtps]", "ros-jazzy-common-interfaces", "./messages")
COMPILER = {"CC": "ccache gcc"} if shutil.which("ccache") else {}
TO_BUILD = ("setuptools>=77.0.3", "Cython>=3.2,<3.3", "numpy>=2")


def add_arguments(parser):
    """The options of a program that can be repeated."""
    parser.add_argument(
        "--all-pythons",
        action="store_true",
        help="run it with each Python from 3.10 to 3.14 that is found in PATH or below ~/.pyenv, and name "
        "those that are not; each gets an environment and a build in .reliability",
    )
    parser.add_argument(
        "--python",
        action="append",
        default=[],
        metavar="PATH",
        help="with --all-pythons: a Python that is not found there; may be repeated",
    )


def environment_of_children(**variables):
    """
    This environment with these variables, for another Python.

    A Python that has the ROS wheels leaves a mark and its own library path to its children. One of another
    environment would take the mark for its own and not find its libraries.
    """
    environment = {**os.environ, **variables}
    if environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None):
        environment.pop("LD_LIBRARY_PATH", None)
    return environment


def interpreters(paths=()):
    """
    By version, the path of an interpreter, or None where none is found.

    :param paths: of interpreters that are used instead of those found.
    """
    found = {version: _find(version) for version in VERSIONS}
    return found | {_version_of(path): str(Path(path).absolute()) for path in paths}


def run_on_all(arguments, paths=()):
    """
    Run Python with these arguments once for each version; the exit status: 0 where all found ones passed.

    :param paths: as of :func:`interpreters`.
    """
    found = interpreters(paths)
    failed = []
    for version, python in found.items():
        if python is None:
            continue
        print(f"--- Python {version}: {python}", flush=True)
        if python == sys.executable:
            usable, folder = python, ROOT
        else:
            usable = python if _has_all(python) else _environment(version, python)
            folder = build(f"py{version.replace('.', '')}", python=usable, **COMPILER)
        environment = environment_of_children(PYTHONPATH=str(folder))
        if subprocess.run([usable, *arguments], cwd=folder, env=environment).returncode:
            failed.append(version)
    missing = [version for version, python in found.items() if python is None]
    print(f"passed: {', '.join(v for v in found if v not in failed and v not in missing) or 'none'}")
    print(f"failed: {', '.join(failed) or 'none'}; not found: {', '.join(missing) or 'none'}", flush=True)
    return 1 if failed else 0


def _find(version):
    if sys.version_info[:2] == tuple(map(int, version.split("."))):
        return sys.executable
    below = sorted((Path.home() / ".pyenv" / "versions").glob(f"{version}.*/bin/python"))
    # A pyenv's own shim in PATH only says that no version is chosen.
    in_path = shutil.which(f"python{version}")
    for python in (*map(str, reversed(below)), in_path):
        if python is not None and _version_of(python) == version:
            return python
    return None


def _version_of(python):
    code = "import sys; print('%d.%d' % sys.version_info[:2])"
    told = subprocess.run([python, "-c", code], capture_output=True, text=True)
    return told.stdout.strip()


def _has_all(python):
    # Outside the checkout, whose packages are built for another Python.
    code = "import rclpy, std_msgs, tf2_msgs, numpy, Cython, setuptools"
    return not subprocess.run([python, "-c", code], cwd="/", capture_output=True).returncode


def _environment(version, python):
    folder = BUILDS / f"venv-{version}"
    usable = folder / "bin" / "python"
    if not usable.exists() or not _has_all(usable):
        shutil.rmtree(folder, ignore_errors=True)
        subprocess.run([python, "-m", "venv", folder], check=True)
        # Only what is needed to build and to run: the project is used from its build.
        subprocess.run([usable, "-m", "pip", "install", "--quiet", *TO_BUILD, *NEEDED], cwd=ROOT, check=True)
    return str(usable)
