"""What the receiver relies on of rclpy's executors in each of their rounds."""

from libc.stdint cimport uintptr_t

# An rclpy.waitable.NumberOfEntities: one guard condition.
cdef object ONE_GUARD_CONDITION

# The address of the rcl struct of a handle of rclpy.
cdef uintptr_t handle_pointer(object handle) except? 0
# Whether an executor's own loop (`rclpy.spin`, `spin`, `spin_until_future_complete`) called what calls this.
# Otherwise user code called the executor, and continues when `spin_once()` returns.
cdef bint called_by_own_loop() except -1
# The same of whatever runs in a frame.
cpdef bint is_below_own_loop(frame) except -1
