"""Find the ROS 2 in use: its folder, its release, and what it lacks."""

import importlib
import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

# By the first number of rclpy's version, which increases with every release.
_RELEASES = {7: "Jazzy", 9: "Kilted"}
_DEFAULT = "Jazzy"


def has_rclpy() -> bool:
    """Whether an rclpy is found, or a program has replaced it by its own module."""
    return _is_made_by_program() or running_prefix() is not None


def absence(what: str = "tf2_ros") -> ModuleNotFoundError:
    """Make the error for a use of ``what`` without rclpy; its text says what to do."""
    return ModuleNotFoundError(_without_rclpy(what), name="rclpy")


def require_messages() -> None:
    """Raise an ImportError with advice if tf2_msgs is missing, or was made for another ROS 2."""
    prefix = running_prefix()
    running = None if prefix is None else rclpy_version(prefix)
    if prefix is None or running is None:
        return  # importing such an rclpy shows what is wrong with it
    spec = importlib.util.find_spec("tf2_msgs")
    at = _describe_at(running, prefix)
    name = _release(running) or _DEFAULT
    if spec is None or spec.origin is None or not spec.submodule_search_locations:
        raise ModuleNotFoundError(
            f"tf2_ros needs tf2_msgs, which the ROS 2 {at} lacks. If you source this ROS 2, install its"
            f" tf2_msgs, on Ubuntu with apt install ros-{name.lower()}-tf2-msgs. If it is from PyPI,"
            f" {_install_messages(name)}",
            name="tf2_msgs",
        )
    folder = Path(next(iter(spec.submodule_search_locations)))
    made_for = messages_release(folder)
    if made_for not in (None, _release(running)):
        raise ImportError(
            f"the tf2_msgs in {folder} is made for ROS 2 {made_for}, but this is ROS 2 {at}. Use the former,"
            f" or, if the latter is from PyPI, pip uninstall tf2-ros-cython-msgs-{made_for.lower()}, then"
            f" {_install_messages(name)}",
            name="tf2_msgs",
        )


def messages_release(folder: Path) -> str | None:
    """Get the ROS 2 for which this project made the tf2_msgs in the folder, or None."""
    try:
        text = (folder / "_release.py").read_text(encoding="utf-8")
    except OSError:
        return None
    found = re.search(r"^RELEASE = '(\w+)'", text, re.MULTILINE)
    return found.group(1).capitalize() if found else None


def running_release() -> str | None:
    """Get the name of the ROS 2 whose rclpy this Python imports; None: no ROS 2, or an unknown one."""
    prefix = running_prefix()
    return None if prefix is None else _release(rclpy_version(prefix))


def unknown_release() -> str | None:
    """Why C functions of the ROS 2 in use cannot be called directly, or None."""
    prefix = running_prefix()
    if prefix is None:
        return "this program has replaced rclpy by its own module"
    running = rclpy_version(prefix)
    if _release(running) is not None:
        return None
    known = " and ".join(f"{name} (rclpy {major})" for major, name in _RELEASES.items())
    return f"known are {known}, and the ROS 2 that runs is {_describe_at(running, prefix)}"


def built() -> ModuleType | None:
    """What the build recorded; None if there was no build, as in a fresh checkout."""
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
    """A release by its name, if it is known, and its rclpy."""
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
    release = "" if name == _DEFAULT else f" -C ros={name.lower()}"
    return f"in a clone of tf2-ros-cython, pip install ./messages{release}"


def _without_rclpy(what: str) -> str:
    return (
        f"{what} needs ROS 2, and no rclpy is found by {sys.executable}: source a ROS 2, or, in a"
        " clone of tf2-ros-cython, pip install ./messages '.[ros]'"
    )


_record = built()
# As in pyproject.toml; unknown if nothing was built, as in a fresh checkout.
__version__: str = "unknown" if _record is None else _record.VERSION
