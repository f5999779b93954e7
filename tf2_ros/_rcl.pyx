"""Find the functions of rcl in the libraries that rclpy has loaded; skip exit handlers of the middleware."""

from libc.stdint cimport uintptr_t

import ctypes

from tf2_ros_cython import _presence, _ros

cdef extern from *:
    """
    #include <stdlib.h>
    /* C's atexit cannot do this, because it does not pass on the exit status. If the C library
       has no on_exit, the handlers run. */
    #ifdef __GLIBC__
    #define tf2_on_exit on_exit
    #else
    #define tf2_on_exit(function, argument) 0
    #endif
    """
    int tf2_on_exit(void (*function)(int status, void* argument) noexcept, void* argument) nogil

cdef extern from "<stdio.h>" nogil:
    ctypedef struct FILE:
        pass
    int fflush(FILE* stream)

cdef extern from "<unistd.h>" nogil:
    void _exit(int status)


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
    if not _presence.HAS_ROS:
        return "there is no rclpy"
    from rclpy.impl.implementation_singleton import rclpy_implementation

    cdef str unknown = _ros.unknown_release()
    if unknown is not None:
        return unknown
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
    except (AttributeError, OSError) as error:
        return f"rclpy's library lacks what listeners call: {error}"
    return None


cdef str _problem = _find_all()


cdef void _end_now(int status, void* _) noexcept nogil:
    fflush(NULL)
    _exit(status)


def skip_exit_handlers():
    """
    End the process, when it exits, before the exit handlers of C and C++ that are registered by now.

    For a forked child: those of the middleware wait for threads of its parent.
    """
    if tf2_on_exit(_end_now, NULL) != 0:
        raise MemoryError
