# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Load the type support libraries that the build puts beside this file."""

import ctypes
import os
import pathlib

_HERE = pathlib.Path(__file__).resolve().parent

# Each needs the one before it. ROS opens them by bare name later on, and the dynamic linker answers that with
# what is already loaded under that name; so nobody has to set LD_LIBRARY_PATH for this package.
_LIBRARIES = (
    "libtf2_msgs__rosidl_generator_c.so",
    "libtf2_msgs__rosidl_typesupport_fastrtps_c.so",
    "libtf2_msgs__rosidl_typesupport_introspection_c.so",
)


def _load_libraries() -> None:
    for name in _LIBRARIES:
        try:
            ctypes.CDLL(str(_HERE / name), mode=ctypes.RTLD_GLOBAL)
        except OSError as error:
            raise ImportError(
                f"tf2_msgs cannot load {name}: {error}; {_advice(name)}", name=__name__
            ) from error


def _advice(library: str) -> str:
    if not (_HERE / library).is_file():
        return f"it is not built in {_HERE}: install it with pip"
    if "_ROS_WHEELS_BOOTSTRAP_COMPLETE" in os.environ:
        return "start Python without _ROS_WHEELS_BOOTSTRAP_COMPLETE set"
    return "the wheels of ROS 2 that it was installed with are gone: install it again with pip"


_load_libraries()
