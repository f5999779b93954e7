# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Store and look up transforms, without ROS nodes or topics."""

import importlib
import sys

try:
    from tf2_py._tf2_py import BufferCore
except ModuleNotFoundError as missing:
    if not (missing.name or "").startswith("tf2_py."):
        raise
    import os

    raise ModuleNotFoundError(
        f"{missing.name} is missing: {os.path.dirname(os.path.dirname(os.path.abspath(__file__)))} has no "
        f"compiled modules for Python {sys.version_info.major}.{sys.version_info.minor}. In a checkout, "
        f"change to another directory or run `make build`; otherwise, reinstall with {sys.executable}",
        name=missing.name,
    ) from None

from tf2_py._objects.errors import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)
from tf2_py._objects.explanations import Explanation as Explanation
from tf2_py._objects.explanations import Hop as Hop
from tf2_py._objects.frame_names import stored_name as stored_name
from tf2_py._objects.late_hints import resolve_late as _resolve_late
from tf2_py._objects.listings import FrameInfo as FrameInfo
from tf2_py._objects.listings import History as History
from tf2_ros_cython._version import __version__ as __version__

for _named_tuple in (Explanation, History, Hop):
    _resolve_late(_named_tuple)

# What `import *` imports from tf2's package.
__all__ = [
    "BufferCore",
    "ConnectivityException",
    "ExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "TimeoutException",
    "TransformException",
]

# tf2's extension imports these two modules, and programs that import only rclpy use them as its attributes.
if sys.modules.get("rclpy") is not None:
    importlib.import_module("rclpy.duration")
    importlib.import_module("rclpy.time")
