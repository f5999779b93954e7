"""
What the receiver uses of rcl and rmw: functions of the libraries that rclpy has loaded, found at run time.

So nothing of ROS is needed to build this, and one build serves each release whose structs are as below: that
is so from Jazzy to Kilted, which `tests/test_rcl.py` compares with the headers of the ROS 2 that runs. Names,
order and types are rcl's and rmw's; of structs that only they fill or read, the bytes alone.
"""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint8_t, uint64_t

cdef extern from "<stdbool.h>" nogil:
    ctypedef bint c_bool "bool"

ctypedef int rcl_ret_t

cdef enum:
    RCL_RET_OK = 0
    RCL_RET_TIMEOUT = 2
    RCL_RET_SUBSCRIPTION_TAKE_FAILED = 401              # there was nothing to take
    RMW_GID_STORAGE_SIZE = 16
    RCUTILS_ERROR_MESSAGE_MAX_LENGTH = 1024

ctypedef struct rmw_gid_t:
    const char* implementation_identifier
    uint8_t[RMW_GID_STORAGE_SIZE] data

ctypedef struct rmw_message_info_t:
    int64_t source_timestamp
    int64_t received_timestamp                          # ns since 1970; 0: the middleware does not tell
    uint64_t publication_sequence_number
    uint64_t reception_sequence_number
    rmw_gid_t publisher_gid
    c_bool from_intra_process

ctypedef void rcl_context_t
ctypedef void rcl_subscription_t
ctypedef void rcl_guard_condition_t
ctypedef void rcl_event_t
ctypedef void rcl_clock_t
ctypedef void rmw_subscription_allocation_t

ctypedef struct rcl_allocator_t:
    void* allocate
    void* deallocate
    void* reallocate
    void* zero_allocate
    void* state

# All zero before rcl_wait_set_init.
ctypedef struct rcl_wait_set_t:
    # After a wait NULL where there is nothing to take, where it was not triggered, and did not happen.
    const rcl_subscription_t** subscriptions
    size_t size_of_subscriptions
    const rcl_guard_condition_t** guard_conditions
    size_t size_of_guard_conditions
    const void** timers
    size_t size_of_timers
    const void** clients
    size_t size_of_clients
    const void** services
    size_t size_of_services
    const rcl_event_t** events
    size_t size_of_events
    void* impl

# All zero before rcutils_uint8_array_init.
ctypedef struct rcl_serialized_message_t:
    uint8_t* buffer
    size_t buffer_length                                # bytes of the message
    size_t buffer_capacity                              # bytes allocated
    rcl_allocator_t allocator

ctypedef struct rcl_error_string_t:
    char[RCUTILS_ERROR_MESSAGE_MAX_LENGTH] str                       # NUL-terminated


# None of them may be called unless `require_rcl()` has succeeded once.
cdef rcl_allocator_t (*rcutils_get_default_allocator)() noexcept nogil
cdef c_bool (*rcl_context_is_valid)(const rcl_context_t* context) noexcept nogil
cdef rcl_ret_t (*rcl_trigger_guard_condition)(rcl_guard_condition_t* guard_condition) noexcept nogil
cdef rcl_ret_t (*rcl_is_enabled_ros_time_override)(rcl_clock_t* clock, c_bool* is_enabled) noexcept nogil
cdef rcl_ret_t (*rcl_clock_get_now)(rcl_clock_t* clock, int64_t* time_ns) noexcept nogil
cdef rcl_ret_t (*rcl_wait_set_init)(
    rcl_wait_set_t* wait_set, size_t subscriptions, size_t guard_conditions, size_t timers,
    size_t clients, size_t services, size_t events, rcl_context_t* context, rcl_allocator_t allocator,
) noexcept nogil
cdef rcl_ret_t (*rcl_wait_set_fini)(rcl_wait_set_t* wait_set) noexcept nogil
cdef rcl_ret_t (*rcl_wait_set_clear)(rcl_wait_set_t* wait_set) noexcept nogil
# `index`, where in the set it went, may be NULL.
cdef rcl_ret_t (*rcl_wait_set_add_subscription)(
    rcl_wait_set_t* wait_set, const rcl_subscription_t* subscription, size_t* index,
) noexcept nogil
cdef rcl_ret_t (*rcl_wait_set_add_guard_condition)(
    rcl_wait_set_t* wait_set, const rcl_guard_condition_t* guard_condition, size_t* index,
) noexcept nogil
cdef rcl_ret_t (*rcl_wait_set_add_event)(
    rcl_wait_set_t* wait_set, const rcl_event_t* event, size_t* index,
) noexcept nogil
cdef rcl_ret_t (*rcl_wait)(rcl_wait_set_t* wait_set, int64_t timeout_ns) noexcept nogil
# The last two, information about the message and memory for it, may be NULL.
cdef rcl_ret_t (*rcl_take_serialized_message)(
    const rcl_subscription_t* subscription, rcl_serialized_message_t* message,
    rmw_message_info_t* information, rmw_subscription_allocation_t* allocation,
) noexcept nogil
# Of this thread's last error. While it is set, another one makes rcl complain on stderr.
cdef rcl_error_string_t (*rcutils_get_error_string)() noexcept nogil
cdef void (*rcutils_reset_error)() noexcept nogil
cdef rcl_ret_t (*rcutils_uint8_array_init)(
    rcl_serialized_message_t* message, size_t capacity, const rcl_allocator_t* allocator,
) noexcept nogil
cdef rcl_ret_t (*rcutils_uint8_array_fini)(rcl_serialized_message_t* message) noexcept nogil


# Raises RuntimeError where the functions were not found.
cdef int require_rcl() except -1
cdef str rcl_last_error()
# Of no bytes: rcl gives it as many as it needs. Whether there was memory for that.
cdef bint message_init(rcl_serialized_message_t* message) noexcept nogil
# No effect on one that is all zero.
cdef void message_free(rcl_serialized_message_t* message) noexcept nogil
