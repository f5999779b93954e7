# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Print which tf2 a program started like this one imports, and why."""

import importlib
import importlib.metadata
import importlib.util
import os
import platform
import re
import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from importlib.machinery import PathFinder
from pathlib import Path
from typing import NoReturn

from tf2_ros_cython import _finder, _installation, _ros_in_use
from tf2_ros_cython._version import __version__

_TOOLS_ADVICE = (
    "not installed; in a clone of tf2-ros-cython, pip install './tools[cli]' adds tf2_echo and others; "
    "in a colcon workspace, link the folder tools into src and build"
)


def main(args: list[str] | None = None) -> int:
    """
    Print which tf2 is imported, from where, and what it takes precedence over.

    :param args: the command line, including the name of the program. None: that of the process.
    :return: 0 if all of our packages are in use, and those that the installation supports load; otherwise 1,
        also if the output cannot be written.
    """
    parser = ArgumentParser(
        "tf2_which",
        description="Show which tf2 this Python imports and from where, and whether it loads.\n\n"
        "Exit status: 0 if this Python loads only tf2-ros-cython; 1 otherwise; 2 after\n"
        "wrong usage.",
        epilog="example:\n  tf2_which",
        formatter_class=RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.error = _refuse  # type: ignore[method-assign]
    if sys.stdout is None:  # closed; the next file that is opened would have its number
        sys.stdout = open(os.devnull, "w")
    try:
        try:
            parser.parse_args((sys.argv if args is None else args)[1:])
        finally:
            sys.stdout.flush()  # argparse ignores that its help cannot be written, and Python would try again
        lines, status = _answer()
        print(*lines, sep="\n", flush=True)
    except OSError as failure:
        # Otherwise the interpreter would try to write the rest once more.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(failure, BrokenPipeError):
            print(f"tf2_which: {failure.strerror}", file=sys.stderr)
        status = 1
    return status


def _refuse(message: str) -> NoReturn:
    # As in all other programs: one line, and status 2.
    print(f"tf2_which: {message} (see tf2_which --help)", file=sys.stderr)
    raise SystemExit(2)


def _answer() -> tuple[list[str], int]:
    """The lines to print, and the exit status."""
    lines = []
    folders = {name: _imported_from(name) for name in (*_installation.PACKAGES, "tf2_msgs")}
    forks = [name for name in _installation.PACKAGES if _is_fork(folders[name])]
    for name, folder in folders.items():
        lines.append(f"{name}: {_describe(name, folder, forks)}")
        for other in _others(name, folder):
            lines.append(f"    takes precedence over {other / name}")
    ours = [_is_ours(folders[name]) for name in _installation.PACKAGES]
    are_ours = all(ours)
    failure = _import_failure() if are_ours else None
    if failure is not None:
        lines.append(f"does not load: {failure}")
    lines.append(f"precedence: {_precedence(any(ours), forks)}")
    lines.append(f"receiver: {_receiver(are_ours, failure)}")
    lines.append(f"ROS 2: {_running_ros()}")
    if are_ours and failure is None and _ros_in_use.running_prefix() is not None:
        lines += [f"    differs from the releases that were tested: {row}" for row in _broken_assumptions()]
    if importlib.util.find_spec("tf2_ros_tools") is None:
        lines.append(f"tools: {_TOOLS_ADVICE}")
    lines.append(f"version: {_versions(folders['tf2_msgs'])}")
    return lines, 0 if are_ours and failure is None else 1


def _imported_from(name: str) -> Path | None:
    """The folder with the package that ``import name`` would import, or a module's file; imports nothing."""
    spec = importlib.util.find_spec(name)
    if spec is None or spec.origin is None:
        return None
    if not spec.submodule_search_locations:
        return Path(spec.origin)
    return Path(next(iter(spec.submodule_search_locations))).absolute().parent


def _is_ours(folder: Path | None) -> bool:
    if folder is None:
        return False
    if folder.parts[-2:] == _installation.PARTS:
        return True
    # In a checkout, all are in one folder; beside others, tf2 may lie there.
    has_own_folder = folder.joinpath(*_installation.PARTS).is_dir()
    return (folder / _installation.PARTS[0] / "which.py").is_file() and not has_own_folder


def _import_failure() -> str | None:
    """Why one of our packages does not load, or None. Without ROS 2, two of them load."""
    for name in _ros_in_use.loadable_packages():
        try:
            importlib.import_module(name)
        except ImportError as error:
            return f"{name}: {error}"
    return None


def _is_fork(folder: Path | None) -> bool:
    """Whether a package is the own one of a workspace, or of a folder on PYTHONPATH."""
    if folder is None or folder.is_file() or _is_ours(folder) or str(folder) == _installation.SITE:
        return False
    prefix = _installation.distribution_prefix()
    if prefix is None:
        return str(folder) in map(os.path.abspath, os.environ.get("PYTHONPATH", "").split(os.pathsep))
    return not _installation.lies_in(str(folder), prefix)


def _describe(name: str, folder: Path | None, forks: list[str]) -> str:
    if folder is None:
        is_to_be_ours = name != "tf2_msgs" and (forks or not _is_arranged())
        return f"not found; {_why_not(name, forks)}" if is_to_be_ours else "not found"
    if folder.is_file():
        return f"not a package, but the module {folder}: rename it"
    if name == "tf2_msgs":
        release = _ros_in_use.messages_release(folder / name)
        origin = f"built by tf2-ros-cython for {release}" if release else "from the environment"
        return f"{origin}, {folder / name}"
    if _is_ours(folder):
        return f"tf2-ros-cython, {folder / name}"
    return f"not tf2-ros-cython, {folder / name}: {_why_not(name, forks)}"


def _why_not(name: str, forks: list[str]) -> str:
    if _installation.is_switched_off():
        return "TF2_ROS_CYTHON=0 is set"
    if _installation.is_waiting():
        return "this installation, by a distribution, waits for TF2_ROS_CYTHON=1"
    if _installation.refused_rclpy() is not None:
        return "the version of rclpy is not supported, see precedence below"
    if name in forks:
        return "packages in a workspace or on PYTHONPATH take precedence"
    return _about_mixing(forks) if forks else _not_arranged()


def _about_mixing(forks: list[str]) -> str:
    names = " and ".join(forks)
    if _installation.distribution_prefix() is None:
        return f"no ROS 2 is sourced: tf2-ros-cython is mixed with the {names} of PYTHONPATH"
    return f"tf2-ros-cython is not mixed with the {names} of a workspace or of PYTHONPATH"


def _others(name: str, folder: Path | None) -> list[Path]:
    """The folders of the path that hold a package of this name, besides the one that is imported."""
    found: list[Path] = []
    own = folder.parent if folder is not None and folder.is_file() else folder
    for entry in sys.path:
        if PathFinder.find_spec(name, [entry]) is not None:
            other = Path(entry).absolute()
            if own is not None and other.resolve() != own.resolve() and other not in found:
                found.append(other)
    return found


def _is_arranged() -> bool:
    return _finder.Finder in sys.meta_path or (
        _installation.HOME != _installation.SITE and _installation.HOME in sys.path
    )


def _not_arranged() -> str:
    if _installation.IS_OPT_IN:
        return "source setup.bash again, because TF2_ROS_CYTHON=1 was not set before"
    if _installation.HOME == _installation.SITE:
        return "tf2-ros-cython is not installed in this Python; install it with pip"
    return (
        f"this Python did not read {_installation.SITE}/tf2_ros_cython.pth when it started, because the "
        f"file is not in its site-packages; add {_installation.HOME} to PYTHONPATH"
    )


def _precedence(has_ours: bool, forks: list[str]) -> str:
    if _installation.is_switched_off():
        lacking = "; without another tf2, tf2-ros-cython is used" if has_ours else ""
        return f"the order of sys.path, because TF2_ROS_CYTHON=0 is set{lacking}"
    if _installation.is_waiting():
        return (
            "the order of sys.path, because a distribution has installed tf2-ros-cython, which then waits "
            "for TF2_ROS_CYTHON=1; set it before you source setup.bash"
        )
    if _installation.refused_rclpy() is not None:
        return f"any other tf2 before tf2-ros-cython: {_installation.unknown_rclpy()}"
    if forks:
        return f"the order of sys.path, because {_about_mixing(forks)}"
    if not _is_arranged():
        return f"the order of sys.path{'' if has_ours else f'; {_not_arranged()}'}"
    prefix = _installation.distribution_prefix()
    if prefix is not None:
        reason = ", because TF2_ROS_CYTHON=1 is set" if _installation.IS_OPT_IN else ""
        return f"workspaces, then tf2-ros-cython, then the tf2 in {prefix}{reason}"
    if "AMENT_PREFIX_PATH" in os.environ:
        return "the order of sys.path; no prefix in AMENT_PREFIX_PATH contains rclpy"
    return "the order of sys.path; no ROS 2 is sourced"


def _receiver(are_ours: bool, failure: str | None) -> str:
    if not are_ours:
        return "not in use, because not all packages are tf2-ros-cython's"
    if failure is not None:
        return "not in use, because tf2_ros does not load"
    if not _ros_in_use.has_rclpy():
        return "not in use without ROS 2"
    reason = importlib.import_module("tf2_ros._rcl").problem()
    if reason is not None:
        return f"not in use; listeners need an executor that spins: {reason}"
    return "in use; listeners need no executor"


def _running_ros() -> str:
    if not _ros_in_use.has_rclpy():
        return "none found; buffers and recordings work without it"
    prefix = _ros_in_use.running_prefix()
    if prefix is None:
        return "rclpy is a module of this program"
    version = _ros_in_use.rclpy_version(prefix)
    return f"{_ros_in_use.describe(version) if version else 'unknown version'} in {prefix}"


def _broken_assumptions() -> list[str]:
    importlib.import_module("tf2_ros._rclpy")  # has a table of its own
    broken: list[str] = importlib.import_module("tf2_py._internal").assumptions.broken()
    return broken


def _versions(messages: Path | None) -> str:
    """The versions that a bug report should contain."""
    named = [f"tf2-ros-cython {__version__}{_newer_sources()}"]
    release = None if messages is None else _ros_in_use.messages_release(messages / "tf2_msgs")
    if release is not None:
        name = f"tf2-ros-cython-msgs-{release.lower()}"
        try:
            named.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            named.append(f"{name} not installed by pip")
    return ", ".join([*named, f"Python {platform.python_version()}"])


def _newer_sources() -> str:
    """What to do in a checkout whose sources have another version than what was built from them."""
    checkout = Path(__file__).resolve().parents[1]
    try:
        project = (checkout / "pyproject.toml").read_text(encoding="utf-8")
    except OSError:
        return ""
    found = re.search(r'^name = "tf2-ros-cython"\nversion = "(.+)"$', project, re.MULTILINE)
    if found is None or found[1] == __version__:
        return ""
    return f" (but the sources are {found[1]}: run `make build` in {checkout})"


if __name__ == "__main__":
    sys.exit(main())
