"""What the receiver uses of rcl and rmw."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint8_t

cdef extern from "<stdbool.h>" nogil:
    ctypedef bint c_bool "bool"

cdef extern from "rmw/types.h" nogil:
    size_t RMW_GID_STORAGE_SIZE
    ctypedef struct rmw_gid_t:
        uint8_t* data                                   # truly an array of RMW_GID_STORAGE_SIZE
    ctypedef struct rmw_message_info_t:
        int64_t received_timestamp                      # ns since 1970; 0: the middleware does not tell
        rmw_gid_t publisher_gid

cdef extern from "rcl/rcl.h" nogil:
    ctypedef int rcl_ret_t
    rcl_ret_t RCL_RET_OK
    rcl_ret_t RCL_RET_TIMEOUT
    rcl_ret_t RCL_RET_SUBSCRIPTION_TAKE_FAILED          # there was nothing to take

    ctypedef struct rcl_context_t:
        pass
    ctypedef struct rcl_subscription_t:
        pass
    ctypedef struct rcl_guard_condition_t:
        pass
    ctypedef struct rcl_event_t:
        pass
    ctypedef struct rcl_clock_t:
        pass
    ctypedef struct rcl_allocator_t:
        pass
    ctypedef struct rcl_wait_set_t:
        # After a wait NULL where there is nothing to take, where it was not triggered, and did not happen.
        const rcl_subscription_t** subscriptions
        const rcl_guard_condition_t** guard_conditions
        const rcl_event_t** events
    ctypedef struct rcl_serialized_message_t:
        uint8_t* buffer
        size_t buffer_length                            # bytes of the message
        size_t buffer_capacity                          # bytes allocated
    ctypedef struct rcl_error_string_t:
        const char* str                                 # truly an array; NUL-terminated

    rcl_allocator_t rcl_get_default_allocator()
    bint rcl_context_is_valid(const rcl_context_t* context)
    rcl_ret_t rcl_trigger_guard_condition(rcl_guard_condition_t* guard_condition)
    rcl_ret_t rcl_is_enabled_ros_time_override(rcl_clock_t* clock, c_bool* is_enabled)
    rcl_ret_t rcl_clock_get_now(rcl_clock_t* clock, int64_t* time_ns)

    rcl_wait_set_t rcl_get_zero_initialized_wait_set()
    rcl_ret_t rcl_wait_set_init(
        rcl_wait_set_t* wait_set, size_t subscriptions, size_t guard_conditions, size_t timers,
        size_t clients, size_t services, size_t events, rcl_context_t* context, rcl_allocator_t allocator,
    )
    rcl_ret_t rcl_wait_set_fini(rcl_wait_set_t* wait_set)
    rcl_ret_t rcl_wait_set_clear(rcl_wait_set_t* wait_set)
    # `index`, where in the set it went, may be NULL.
    rcl_ret_t rcl_wait_set_add_subscription(
        rcl_wait_set_t* wait_set, const rcl_subscription_t* subscription, size_t* index,
    )
    rcl_ret_t rcl_wait_set_add_guard_condition(
        rcl_wait_set_t* wait_set, const rcl_guard_condition_t* guard_condition, size_t* index,
    )
    rcl_ret_t rcl_wait_set_add_event(rcl_wait_set_t* wait_set, const rcl_event_t* event, size_t* index)
    rcl_ret_t rcl_wait(rcl_wait_set_t* wait_set, int64_t timeout_ns)

    # The last two, information about the message and memory for it, may be NULL.
    rcl_ret_t rcl_take_serialized_message(
        const rcl_subscription_t* subscription, rcl_serialized_message_t* message,
        rmw_message_info_t* information, void* allocation,
    )

cdef extern from "rcl/error_handling.h" nogil:
    # Of this thread's last error. While it is set, another one makes rcl complain on stderr.
    rcl_error_string_t rcl_get_error_string()
    void rcl_reset_error()

cdef extern from "rmw/serialized_message.h" nogil:
    rcl_serialized_message_t rmw_get_zero_initialized_serialized_message()
    rcl_ret_t rmw_serialized_message_init(
        rcl_serialized_message_t* message, size_t capacity, const rcl_allocator_t* allocator,
    )
    rcl_ret_t rmw_serialized_message_fini(rcl_serialized_message_t* message)


cdef inline str rcl_last_error():
    cdef rcl_error_string_t error = rcl_get_error_string()
    rcl_reset_error()
    return error.str.decode("utf-8", "replace")


# Of no bytes: rcl gives it as many as it needs. Whether there was memory for that.
cdef inline bint message_init(rcl_serialized_message_t* message) noexcept nogil:
    cdef rcl_allocator_t allocator = rcl_get_default_allocator()
    message[0] = rmw_get_zero_initialized_serialized_message()
    return rmw_serialized_message_init(message, 0, &allocator) == RCL_RET_OK


cdef inline void message_free(rcl_serialized_message_t* message) noexcept nogil:
    if rmw_serialized_message_fini(message) != RCL_RET_OK:
        rcl_reset_error()
