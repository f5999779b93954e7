"""Owns what is known of the ROS 2 that runs: where it is, which release, what it lacks."""

import importlib
import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

# By the first number of rclpy's version, which every release raises.
_RELEASES = {7: "Jazzy", 9: "Kilted"}
_EXTRAS = {"Jazzy": "ros", "Kilted": "ros-kilted"}
_DEFAULT = "Jazzy"


def has_rclpy() -> bool:
    """Whether an rclpy is found, or a program has put a module of its own in its place."""
    return _is_made_by_program() or running_prefix() is not None


def absence(what: str = "tf2_ros") -> ModuleNotFoundError:
    """What to raise where ``what`` is asked for and no rclpy is found; the text says what to do."""
    return ModuleNotFoundError(_without_rclpy(what), name="rclpy")


def require_messages() -> None:
    """Raise ImportError, naming what to do, where tf2_msgs is lacking, or is made for another ROS 2."""
    prefix = running_prefix()
    running = None if prefix is None else rclpy_version(prefix)
    if prefix is None or running is None:
        return  # what is wrong with such an rclpy its import tells
    spec = importlib.util.find_spec("tf2_msgs")
    at = _describe_at(running, prefix)
    name = _release(running) or _DEFAULT
    if spec is None or spec.origin is None or not spec.submodule_search_locations:
        raise ModuleNotFoundError(
            f"tf2_ros needs tf2_msgs, which is not found beside the ROS 2 {at}: where that is sourced,"
            f" install its tf2_msgs, on Ubuntu by apt install ros-{name.lower()}-tf2-msgs; with the wheels of"
            f" PyPI: {_install_messages(name)}",
            name="tf2_msgs",
        )
    folder = Path(next(iter(spec.submodule_search_locations)))
    made_for = messages_release(folder)
    if made_for not in (None, _release(running)):
        raise ImportError(
            f"the tf2_msgs in {folder} is made for ROS 2 {made_for}, and the one that runs is {at}: run it"
            " with the former, or, with the wheels of PyPI: pip uninstall"
            f" tf2-ros-cython-msgs-{made_for.lower()}, then {_install_messages(name)}",
            name="tf2_msgs",
        )


def messages_release(folder: Path) -> str | None:
    """For which ROS 2 this project's tf2_msgs in the folder is made; None: it is another one."""
    try:
        text = (folder / "_release.py").read_text(encoding="utf-8")
    except OSError:
        return None
    found = re.search(r"^RELEASE = '(\w+)'", text, re.MULTILINE)
    return found.group(1).capitalize() if found else None


def running_release() -> str | None:
    """The name of the ROS 2 whose rclpy this Python imports; None: there is none, or an unknown one."""
    prefix = running_prefix()
    return None if prefix is None else _release(rclpy_version(prefix))


def unknown_release() -> str | None:
    """Why functions of the ROS 2 that runs cannot be called without rclpy, or None."""
    prefix = running_prefix()
    if prefix is None:
        return "rclpy is a module of this program's own"
    running = rclpy_version(prefix)
    if _release(running) is not None:
        return None
    known = " and ".join(f"{name} (rclpy {major})" for major, name in _RELEASES.items())
    return f"known are {known}, and the ROS 2 that runs is {_describe_at(running, prefix)}"


def built() -> ModuleType | None:
    """What the build noted; None where there was no build, as in a fresh checkout."""
    try:
        return importlib.import_module("tf2_ros_cython._built")
    except ModuleNotFoundError:
        return None


def running_prefix() -> Path | None:
    """The prefix of the ROS 2 whose rclpy this Python imports."""
    spec = None if _is_made_by_program() else importlib.util.find_spec("rclpy")
    if spec is None or spec.origin is None:
        return None
    # <prefix>/lib/python3.x/site-packages/rclpy/__init__.py
    parents = Path(spec.origin).parents
    return parents[4] if len(parents) > 4 else parents[0]


def rclpy_version(prefix: Path) -> str | None:
    """The version that a prefix's rclpy declares, or None."""
    try:
        manifest = (prefix / "share" / "rclpy" / "package.xml").read_text(encoding="utf-8")
    except OSError:
        return None
    found = re.search(r"<version>\s*([\d.]+)", manifest)
    return found.group(1) if found else None


def describe(version: str) -> str:
    """A release by its name, where it is one that this knows, and its rclpy."""
    name = _release(version)
    return f"{name} (rclpy {version})" if name else f"of rclpy {version}"


def _is_made_by_program() -> bool:
    # What Python has imported has a spec; None keeps it from being imported.
    module = sys.modules.get("rclpy")
    return module is not None and getattr(module, "__spec__", None) is None


def _release(version: str | None) -> str | None:
    return _RELEASES.get(int(version.partition(".")[0])) if version else None


def _describe_at(version: str | None, prefix: Path) -> str:
    return f"{describe(version) if version else 'of unknown version'} in {prefix}"


def _install_messages(name: str) -> str:
    return f"pip install 'tf2-ros-cython[{_EXTRAS[name]}]', in its sources: pip install ./messages"


def _without_rclpy(what: str) -> str:
    extra = _EXTRAS[_DEFAULT]
    return (
        f"{what} needs ROS 2, and no rclpy is found by {sys.executable}: source a ROS 2, or:"
        f" pip install 'tf2-ros-cython[{extra}]', in its sources: pip install ./messages '.[{extra}]'"
    )
