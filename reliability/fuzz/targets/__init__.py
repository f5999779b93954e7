"""What is fuzzed: a module for each target, with ``run(data)`` and ``seeds()``; both need no fuzzer."""

import importlib
from types import ModuleType

__all__ = ["IN_PYTHON", "MOST_BYTES", "PACKAGES", "target"]

# The Python packages whose branches guide the search in each target; those of the extensions always do.
PACKAGES = {
    "cdr": ["tf2_py._core"],
    "cdr_ros": ["tf2_py"],
    "objects": ["tf2_py", "tf2_geometry_msgs", "tf2_sensor_msgs"],
    "clouds": ["tf2_sensor_msgs"],
    "recordings": ["tf2_ros_tools", "rosbags", "mcap"],
    "saved": ["tf2_py", "mcap"],
    "segments": ["tf2_py", "tf2_ros._shared"],
    "foreign": ["tf2_ros_tools"],
}
# The sizes of inputs.
MOST_BYTES = {
    "cdr": 1024,
    "cdr_ros": 1024,
    "objects": 512,
    "clouds": 1024,
    "recordings": 12000,
    "saved": 8192,
    "segments": 512,
    "foreign": 1024,
}

# In these Python does nearly all of the work.
IN_PYTHON = {"recordings", "saved", "foreign"}


def target(name: str) -> ModuleType:
    """The module of a target; none is imported before it is asked for, so that a fuzzer can instrument it."""
    return importlib.import_module(f"reliability.fuzz.targets.{name}")
