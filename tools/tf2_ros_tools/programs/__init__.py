# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The programs: each module is one, with its command line and its work."""

from importlib.util import find_spec

if find_spec("tf2_ros_cython") is None:
    raise SystemExit(
        "tf2-ros-tools needs tf2-ros-cython, which this Python does not have: in a clone of tf2-ros-cython, "
        "pip install ."
    )

try:
    import tf2_py.printable  # noqa: F401
except ImportError as lack:
    # Another tf2_py, or ours for another Python.
    raise SystemExit(f"{lack}; tf2_which shows which tf2_py is imported") from None
