"""The programs: each module is one, with its command line and its work."""

from importlib.util import find_spec

if find_spec("tf2_ros_cython") is None:
    raise SystemExit(
        "tf2-ros-tools needs tf2-ros-cython, which this Python does not have: in a clone of tf2-ros-cython, "
        "pip install ."
    )
