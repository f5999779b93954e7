# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
What the receiver uses of rcl and rmw: functions of the libraries that rclpy has loaded, found at run time.

So nothing of ROS is needed to build this, and one build serves each release that has these functions, also
one that is newer than this. `tests/ros/test_rcl_declarations.py` compares the declarations with the headers
of the ROS 2 that runs. Names, order and types are those of rcl and rmw. Structs that only they fill or read
are declared as bytes; what they fill has room for members that a release may have beyond those declared
here.
"""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint8_t, uint64_t

cdef extern from "<stdbool.h>" nogil:
    ctypedef bint c_bool "bool"

ctypedef int rcl_ret_t

cdef enum:
    RCL_RET_OK = 0
    RCL_RET_SUBSCRIPTION_TAKE_FAILED = 401                 # there is no message

ctypedef struct rmw_gid_t:
    const char* implementation_identifier
    uint8_t[16] data                                    # Humble's has 24 bytes, of which the first identify

ctypedef struct rmw_message_info_t:
    int64_t source_timestamp
    int64_t received_timestamp                          # ns since 1970; 0: the middleware does not report it
    uint64_t publication_sequence_number
    uint64_t reception_sequence_number
    rmw_gid_t publisher_gid                             # and what else a release has

# As rcl is given it, with room for what is not declared.
cdef struct MessageInfo:
    rmw_message_info_t known
    char[256] appended

ctypedef void rcl_subscription_t
ctypedef void rcl_guard_condition_t
ctypedef void rcl_clock_t
ctypedef void rmw_subscription_allocation_t
ctypedef void (*rcl_event_callback_t)(const void* user_data, size_t number_of_events) noexcept nogil

ctypedef struct rcl_allocator_t:
    void* allocate
    void* deallocate
    void* reallocate
    void* zero_allocate
    void* state

# It has an allocator; rcl gives it as many bytes as it needs.
ctypedef struct rcl_serialized_message_t:
    uint8_t* buffer
    size_t buffer_length                                # bytes of the message
    size_t buffer_capacity                              # bytes allocated
    rcl_allocator_t allocator


# None of them may be called unless `require_rcl()` has succeeded once.
cdef rcl_ret_t (*rcl_trigger_guard_condition)(rcl_guard_condition_t* guard_condition) noexcept nogil
cdef rcl_ret_t (*rcl_is_enabled_ros_time_override)(rcl_clock_t* clock, c_bool* is_enabled) noexcept nogil
cdef rcl_ret_t (*rcl_clock_get_now)(rcl_clock_t* clock, int64_t* time_ns) noexcept nogil
# From now on, `callback` is called with `user_data` and a number of messages: at once for those that nobody
# has taken, then for those that arrive. It is called in the thread of the middleware or of a publisher, under
# a lock of the middleware. With `callback` NULL, no calls are made any more, and none runs when this returns.
cdef rcl_ret_t (*rcl_subscription_set_on_new_message_callback)(
    const rcl_subscription_t* subscription, rcl_event_callback_t callback, const void* user_data,
) noexcept nogil
# The last two, information about the message and memory for it, may be NULL.
cdef rcl_ret_t (*rcl_take_serialized_message)(
    const rcl_subscription_t* subscription, rcl_serialized_message_t* message,
    rmw_message_info_t* information, rmw_subscription_allocation_t* allocation,
) noexcept nogil
# That of malloc and free.
cdef rcl_allocator_t (*rcutils_get_default_allocator)() noexcept nogil
# Of this thread's last error. While it is set, another error makes rcl complain on stderr.
cdef void (*rcutils_reset_error)() noexcept nogil

# Raises RuntimeError if the functions were not found.
cdef int require_rcl() except -1
