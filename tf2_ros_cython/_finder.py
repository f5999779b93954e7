"""
Give our packages precedence over the tf2 of a sourced ROS 2, whose folder precedes site-packages on the path.

The .pth file of the installation imports this module when Python starts, if AMENT_PREFIX_PATH is set. So it
imports only what Python has already loaded, and reads the disk only when one of our packages is imported.
"""

import os
import sys

TYPE_CHECKING = False  # to type checkers it is True; `typing` is not imported for it
if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from importlib.machinery import ModuleSpec, PathFinder
    from types import ModuleType

# In the order of their layers: each of ours builds on ours of the layers before it.
PACKAGES = ("tf2_py", "tf2_ros", "tf2_geometry_msgs", "tf2_sensor_msgs")

HOME = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))

_RCLPY_MARKER = os.path.join("share", "ament_index", "resource_index", "packages", "rclpy")


class Finder:
    """Finds our packages if the path leads to those of the ROS 2 distribution."""

    @staticmethod
    def find_spec(
        name: str, path: "Sequence[str] | None" = None, target: "ModuleType | None" = None
    ) -> "ModuleSpec | None":
        if name not in PACKAGES or not precedes(name):
            return None
        return _path_finder().find_spec(name, [HOME])


def install() -> None:
    """Put the finder before Python's, once."""
    if Finder not in sys.meta_path:
        sys.meta_path.insert(0, Finder)


def precedes(name: str) -> bool:
    """
    Whether ours takes precedence over the package ``name`` that the path offers.

    It does if that is the distribution's, and no layer below it is from a workspace: a workspace with a fork
    of one package keeps it, together with the distribution's packages that build on it.
    """
    prefix = distribution_prefix()
    if prefix is None or not _lies_in(found_on_path(name), prefix):
        return False
    below = PACKAGES[: PACKAGES.index(name)]
    found = [found_on_path(package) for package in below]
    return all(folder in (None, HOME) or _lies_in(folder, prefix) for folder in found)


def found_on_path(name: str) -> str | None:
    """The folder of the path that holds the package ``name``, or None."""
    spec = _path_finder().find_spec(name)
    if spec is None or not spec.submodule_search_locations:
        return None
    return os.path.dirname(os.path.abspath(next(iter(spec.submodule_search_locations))))


def distribution_prefix(environ: "Mapping[str, str]" = os.environ) -> str | None:
    """
    The folder in which the ROS 2 distribution is installed: the lowest one that holds rclpy.

    So a workspace above it with an rclpy of its own still counts as a workspace. A distribution built with
    colcon may have a folder for each package; then this is the folder that contains them.
    """
    for prefix in reversed(environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        if prefix and os.path.isfile(os.path.join(prefix, _RCLPY_MARKER)):
            parent = os.path.dirname(os.path.abspath(prefix))
            return parent if _is_isolated(parent) else os.path.abspath(prefix)
    return None


def _is_isolated(folder: str) -> bool:
    try:
        with open(os.path.join(folder, ".colcon_install_layout"), encoding="utf-8") as file:
            return file.read().strip() == "isolated"
    except OSError:
        return False


def _lies_in(folder: str | None, prefix: str) -> bool:
    if folder is None:
        return False
    return os.path.realpath(folder).startswith(os.path.join(os.path.realpath(prefix), ""))


def _path_finder() -> "type[PathFinder]":
    from importlib.machinery import PathFinder

    return PathFinder
