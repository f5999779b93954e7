"""Owns the comparison of the ROS 2 that runs with the one that this installation was built for."""

import importlib
import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

# By the first number of rclpy's version, which every distribution raises.
_DISTRIBUTIONS = {7: "Jazzy", 9: "Kilted"}
_WHEELS = {"Jazzy": "'.[ros]'", "Kilted": "'.[ros-kilted]' -C ros=kilted"}


def has_rclpy() -> bool:
    """Whether an rclpy is found, or a program has put a module of its own in its place."""
    return _is_made_by_program() or running_prefix() is not None


def absence(what: str = "tf2_ros") -> ModuleNotFoundError:
    """What to raise where ``what`` is asked for and no rclpy is found; the text says what to do."""
    return ModuleNotFoundError(_without_rclpy(what), name="rclpy")


def require_ros() -> None:
    """Raise ImportError, naming what to do, where another ROS 2 is found than the one built for."""
    prefix, record = running_prefix(), built()
    if prefix is None or record is None:
        return
    running = rclpy_version(prefix)
    if record.RCLPY is None:
        if importlib.util.find_spec("tf2_msgs") is None:
            raise ModuleNotFoundError(
                f"tf2_ros was built without ROS 2, and without tf2_msgs: in its sources, {_rebuild(running)}",
                name="tf2_msgs",
            )
    elif running is not None and _major(running) != _major(record.RCLPY):
        raise ImportError(
            f"tf2_ros was built for ROS 2 {describe(record.RCLPY)}, and the one that runs is"
            f" {describe(running)} in {prefix}: run it with the former, or, for the latter, in its sources,"
            f" {_rebuild(running)}",
            name="tf2_ros",
        )


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
    """A distribution by its name, where it is one that this knows, and its rclpy."""
    name = _DISTRIBUTIONS.get(_major(version))
    return f"{name} (rclpy {version})" if name else f"of rclpy {version}"


def _is_made_by_program() -> bool:
    # What Python has imported has a spec; None keeps it from being imported.
    module = sys.modules.get("rclpy")
    return module is not None and getattr(module, "__spec__", None) is None


def _major(version: str) -> int:
    return int(version.partition(".")[0])


def _rebuild(running: str | None) -> str:
    name = _DISTRIBUTIONS.get(_major(running)) if running else None
    wheels = f"; with the wheels of PyPI: pip install {_WHEELS[name]}" if name else ""
    return f"with that ROS 2 sourced: pip install .{wheels}"


def _without_rclpy(what: str) -> str:
    record = built()
    missing = f"{what} needs ROS 2, and no rclpy is found by {sys.executable}"
    if record is None or record.RCLPY is None:
        return (
            f"{missing}; tf2_ros was built without ROS 2, too. In its sources: pip install '.[ros]', which"
            " brings ROS 2 from PyPI; or, with a ROS 2 sourced: pip install ."
        )
    name = _DISTRIBUTIONS.get(_major(record.RCLPY), "")
    wheels = f"'ros-{name.lower()}-rclpy[fastrtps]' ros-{name.lower()}-common-interfaces"
    bring = f", or: pip install {wheels}, or in its sources: pip install {_WHEELS[name]}" if name else ""
    return f"{missing}: source a ROS 2 {describe(record.RCLPY)}{bring}"
