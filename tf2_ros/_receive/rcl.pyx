"""Owns finding the functions of rcl in the libraries that rclpy has loaded."""

from libc.stdint cimport uintptr_t
from libc.string cimport memset

import ctypes

from rclpy.impl.implementation_singleton import rclpy_implementation

from tf2_ros_cython import _ros


def problem():
    """Why nothing of rcl can be called here, or None."""
    return _problem


cdef int require_rcl() except -1:
    if _problem is not None:
        raise RuntimeError(_problem)
    return 0


cdef str rcl_last_error():
    cdef rcl_error_string_t error = rcutils_get_error_string()
    rcutils_reset_error()
    return (<bytes>error.str).decode("utf-8", "replace")


cdef bint message_init(rcl_serialized_message_t* message) noexcept nogil:
    cdef rcl_allocator_t allocator = rcutils_get_default_allocator()
    memset(message, 0, sizeof(message[0]))
    return rcutils_uint8_array_init(message, 0, &allocator) == RCL_RET_OK


cdef void message_free(rcl_serialized_message_t* message) noexcept nogil:
    if message.allocator.allocate != NULL and rcutils_uint8_array_fini(message) != RCL_RET_OK:
        rcutils_reset_error()


cdef int _find(library, str name, void** function) except -1:
    function[0] = <void*><uintptr_t>ctypes.cast(library[name], ctypes.c_void_p).value
    return 0


cdef str _find_all():
    # Looked for among what rclpy's own extension is linked with: so it is the rcl that rclpy calls.
    cdef str unknown = _ros.unknown_release()
    if unknown is not None:
        return unknown
    try:
        library = ctypes.PyDLL(rclpy_implementation.__file__)
        _find(library, "rcutils_get_default_allocator", <void**>&rcutils_get_default_allocator)
        _find(library, "rcl_context_is_valid", <void**>&rcl_context_is_valid)
        _find(library, "rcl_trigger_guard_condition", <void**>&rcl_trigger_guard_condition)
        _find(library, "rcl_is_enabled_ros_time_override", <void**>&rcl_is_enabled_ros_time_override)
        _find(library, "rcl_clock_get_now", <void**>&rcl_clock_get_now)
        _find(library, "rcl_wait_set_init", <void**>&rcl_wait_set_init)
        _find(library, "rcl_wait_set_fini", <void**>&rcl_wait_set_fini)
        _find(library, "rcl_wait_set_clear", <void**>&rcl_wait_set_clear)
        _find(library, "rcl_wait_set_add_subscription", <void**>&rcl_wait_set_add_subscription)
        _find(library, "rcl_wait_set_add_guard_condition", <void**>&rcl_wait_set_add_guard_condition)
        _find(library, "rcl_wait_set_add_event", <void**>&rcl_wait_set_add_event)
        _find(library, "rcl_wait", <void**>&rcl_wait)
        _find(library, "rcl_take_serialized_message", <void**>&rcl_take_serialized_message)
        _find(library, "rcutils_get_error_string", <void**>&rcutils_get_error_string)
        _find(library, "rcutils_reset_error", <void**>&rcutils_reset_error)
        _find(library, "rcutils_uint8_array_init", <void**>&rcutils_uint8_array_init)
        _find(library, "rcutils_uint8_array_fini", <void**>&rcutils_uint8_array_fini)
    except (AttributeError, OSError) as error:
        return f"rclpy's library lacks what listeners call: {error}"
    return None


cdef str _problem = _find_all()
