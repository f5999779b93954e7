# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Find the ROS 2 in use: its folder, its release, and what it lacks."""

import importlib.util
import re
import sys
from pathlib import Path

from tf2_ros_cython._installation import OLDEST_RCLPY, PACKAGES

# By the first number of rclpy's version, which increases with every release. Only texts depend on them.
_RELEASES = {3: "Humble", 7: "Jazzy", 9: "Kilted", 10: "Lyrical"}
# Those for which messages/ can be built; the default first.
_ON_PYPI = ("Jazzy", "Kilted")

_WITHOUT_ROS = ("tf2_py", "tf2_ros")  # what loads without one

# On which generated messages are built: its minor versions are not interchangeable.
_TYPE_SUPPORT = "rosidl_typesupport_fastrtps_c"


def has_rclpy() -> bool:
    """Whether an rclpy is found, or a program has replaced it by its own module."""
    return _is_made_by_program() or running_prefix() is not None


def loadable_packages() -> tuple[str, ...]:
    """Our packages, without those that need a ROS 2 if there is none."""
    return PACKAGES if has_rclpy() else _WITHOUT_ROS


def absence(what: str = "this") -> ModuleNotFoundError:
    """Make the error for a use of ``what`` without rclpy; its text says what to do."""
    text = (
        f"{what} needs ROS 2, but {sys.executable} finds no rclpy: source ROS 2, or run in a clone of"
        " tf2-ros-cython: pip install ./messages '.[ros]'"
    )
    if "listener" in what.lower() or "broadcaster" in what.lower():
        text += ". Without ROS 2, tf2_ros_tools.live receives and sends the transforms of a robot"
    return ModuleNotFoundError(text, name="rclpy")


def require_messages() -> None:
    """Raise an ImportError with advice if tf2_msgs is missing, or needs the libraries of another ROS 2."""
    prefix = running_prefix()
    running = None if prefix is None else rclpy_version(prefix)
    if prefix is None or running is None:
        return  # importing such an rclpy shows what is wrong with it
    spec = importlib.util.find_spec("tf2_msgs")
    at = f"{describe(running)} in {prefix}"
    if int(running.partition(".")[0]) < OLDEST_RCLPY:
        oldest = f"rclpy {OLDEST_RCLPY} ({_RELEASES[OLDEST_RCLPY]})"
        raise ImportError(
            f"tf2_ros needs {oldest} or newer, but this is rclpy {running} in {prefix}", name="rclpy"
        )
    name = _release(running)
    if spec is None or spec.origin is None or not spec.submodule_search_locations:
        raise ModuleNotFoundError(
            f"tf2_ros needs tf2_msgs, which is missing in ROS 2 {at}. {_install_messages(name)}",
            name="tf2_msgs",
        )
    folder = Path(next(iter(spec.submodule_search_locations)))
    needed, found = _messages_note(folder, "TYPE_SUPPORT"), _running_type_support()
    # The release of rclpy does not matter: a workspace may have a newer one than its other libraries.
    if None in (needed, found) or needed == found:
        return
    made_for = str(messages_release(folder))
    raise ImportError(
        f"the tf2_msgs in {folder} was built for ROS 2 {made_for} ({_TYPE_SUPPORT} {needed}), but this is"
        f" ROS 2 {at} ({_TYPE_SUPPORT} {found}). Use ROS 2 {made_for}, or run pip uninstall"
        f" tf2-ros-cython-msgs-{made_for.lower()}. {_install_messages(name)}",
        name="tf2_msgs",
    )


def messages_release(folder: Path) -> str | None:
    """Get the ROS 2 for which this project made the tf2_msgs in the folder, or None."""
    name = _messages_note(folder, "RELEASE")
    return name.capitalize() if name else None


def _messages_note(folder: Path, what: str) -> str | None:
    """Get what the build of tf2_msgs noted in its folder; None if this project did not make it."""
    try:
        text = (folder / "_release.py").read_text(encoding="utf-8")
    except OSError:
        return None
    found = re.search(rf"^{what} = '([\w.]+)'", text, re.MULTILINE)
    return found.group(1) if found else None


def _running_type_support() -> str | None:
    """The minor version of the type support beside the geometry_msgs that this Python imports, or None."""
    spec = importlib.util.find_spec("geometry_msgs")
    prefix = None if spec is None or spec.origin is None else _prefix_of(spec.origin)
    version = None if prefix is None else _manifest_version(prefix, _TYPE_SUPPORT)
    return None if version is None else ".".join(version.split(".")[:2])


def running_release() -> str | None:
    """Get the name of the ROS 2 whose rclpy this Python imports; None: no ROS 2, or an unknown one."""
    prefix = running_prefix()
    return None if prefix is None else _release(rclpy_version(prefix))


def running_prefix() -> Path | None:
    """The prefix of the ROS 2 whose rclpy this Python imports."""
    spec = None if _is_made_by_program() else importlib.util.find_spec("rclpy")
    if spec is None or spec.origin is None:
        return None
    return _prefix_of(spec.origin)


def _prefix_of(origin: str) -> Path:
    # <prefix>/lib/python3.x/site-packages/rclpy/__init__.py
    parents = Path(origin).parents
    return parents[4] if len(parents) > 4 else parents[0]


def rclpy_version(prefix: Path) -> str | None:
    """The version that a prefix's rclpy declares, or None."""
    return _manifest_version(prefix, "rclpy")


def _manifest_version(prefix: Path, package: str) -> str | None:
    try:
        # Of any encoding: the version is ASCII.
        manifest = (prefix / "share" / package / "package.xml").read_text(encoding="latin-1")
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


def _install_messages(name: str | None) -> str:
    distribution = "$ROS_DISTRO" if name is None else name.lower()
    advice = (
        f"If you source this ROS 2, install its tf2_msgs; on Ubuntu: apt install ros-{distribution}-tf2-msgs."
    )
    if name in (None, *_ON_PYPI):
        release = f" --config-settings ros={distribution}" if name in _ON_PYPI[1:] else ""
        advice += f" If it is from PyPI, run in a clone of tf2-ros-cython: pip install ./messages{release}"
    return advice
