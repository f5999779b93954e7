# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Find the functions of rcl in the libraries that rclpy has loaded."""

from libc.stdint cimport uintptr_t

import ctypes

from tf2_ros_cython import _ros_in_use, _ros_presence


def problem():
    """Why no function of rcl can be called here, or None."""
    return _problem


cdef int require_rcl() except -1:
    if _problem is not None:
        raise RuntimeError(_problem)
    return 0


cdef int _find(library, str name, void** function) except -1:
    function[0] = <void*><uintptr_t>ctypes.cast(library[name], ctypes.c_void_p).value
    return 0


cdef str _find_all():
    # Searched in the libraries that rclpy's extension is linked with, so it is the rcl that rclpy calls.
    if not _ros_presence.HAS_ROS:
        return "rclpy is not installed"
    from rclpy.impl.implementation_singleton import rclpy_implementation

    if _ros_in_use.running_prefix() is None:
        return "this program has replaced rclpy by its own module"
    try:
        library = ctypes.PyDLL(rclpy_implementation.__file__)
        _find(library, "rcl_trigger_guard_condition", <void**>&rcl_trigger_guard_condition)
        _find(library, "rcl_is_enabled_ros_time_override", <void**>&rcl_is_enabled_ros_time_override)
        _find(library, "rcl_clock_get_now", <void**>&rcl_clock_get_now)
        _find(library, "rcl_subscription_set_on_new_message_callback",
              <void**>&rcl_subscription_set_on_new_message_callback)
        _find(library, "rcl_take_serialized_message", <void**>&rcl_take_serialized_message)
        _find(library, "rcutils_get_default_allocator", <void**>&rcutils_get_default_allocator)
        _find(library, "rcutils_reset_error", <void**>&rcutils_reset_error)
        for name in ("Clock", "GuardCondition", "Subscription"):
            getattr(rclpy_implementation, name).pointer     # the address of its struct of rcl
    except (AttributeError, OSError) as error:
        return f"rclpy's library lacks functions that listeners need: {error}"
    return None


cdef str _problem = _find_all()
