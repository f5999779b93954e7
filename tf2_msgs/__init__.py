"""Owns the loading of the type support libraries that the build puts beside this file."""

import ctypes
import importlib.machinery
import os
import pathlib
import sys

_HERE = pathlib.Path(__file__).resolve().parent

# What the search for another `tf2_msgs` must not find: this one, and a copy of it that handed over to it.
_SEEN = [*globals().get("_SEEN", []), _HERE.parent]

# Each needs the one before it. ROS opens them by bare name later on, and the dynamic linker answers that with
# what is already loaded under that name; so nobody has to set LD_LIBRARY_PATH for this package.
_LIBRARIES = (
    "libtf2_msgs__rosidl_generator_c.so",
    "libtf2_msgs__rosidl_typesupport_fastrtps_c.so",
    "libtf2_msgs__rosidl_typesupport_introspection_c.so",
)


def _is_sourced_elsewhere() -> bool:
    """Whether a sourced ROS 2 holds the package, by the marker that every ament package installs."""
    marker = pathlib.Path("share", "ament_index", "resource_index", "packages", __name__)
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        if (pathlib.Path(prefix) / marker).is_file():
            return not _HERE.is_relative_to(pathlib.Path(prefix).resolve())
    return False


def _hand_over() -> None:
    """Become the other `tf2_msgs` on the path: in a checkout beside a sourced ROS 2 none is built."""
    elsewhere = [entry for entry in sys.path if pathlib.Path(entry or ".").resolve() not in _SEEN]
    spec = importlib.machinery.PathFinder.find_spec(__name__, elsewhere)
    if spec is None or spec.submodule_search_locations is None or spec.loader is None:
        raise ImportError(f"tf2_msgs is not built in {_HERE}: install the project with pip", name=__name__)
    module = sys.modules[__name__]
    module.__spec__, module.__file__ = spec, spec.origin
    module.__path__[:] = spec.submodule_search_locations
    spec.loader.exec_module(module)


def _load_libraries() -> None:
    for name in _LIBRARIES:
        try:
            ctypes.CDLL(str(_HERE / name), mode=ctypes.RTLD_GLOBAL)
        except OSError as error:
            advice = "it needs ROS 2: pip install 'tf2-ros-cython[ros]'"
            if "_ROS_WHEELS_BOOTSTRAP_COMPLETE" in os.environ:
                advice += "; where that is installed, start Python without _ROS_WHEELS_BOOTSTRAP_COMPLETE set"
            raise ImportError(f"tf2_msgs cannot load {name}: {error}; {advice}", name=__name__) from error


# A checkout may hold what was built before that ROS 2 was sourced.
if (_HERE / _LIBRARIES[0]).is_file() and not _is_sourced_elsewhere():
    _load_libraries()
else:
    _hand_over()
