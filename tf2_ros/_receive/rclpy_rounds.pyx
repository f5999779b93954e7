"""
Owns what the receiver relies on of rclpy's executors in each of their rounds, where Python would be too slow.

The Python part is ``tf2_ros._rclpy``. Each assumption has a test in tests/test_rclpy_inside.py, and was
tested with rclpy 7.1 (Jazzy) and 9.1 (Kilted).
"""

from libc.stdint cimport uintptr_t

import sys

import rclpy
from rclpy.executors import Executor
from rclpy.waitable import NumberOfEntities


class _OneGuardCondition(NumberOfEntities):
    """
    Added to other numbers in each round of an executor, without the slow addition of rclpy 7.

    Assumes that an executor adds it in place, ``numbers += waitable.get_num_entities()``, and keeps no
    reference to it. An executor that uses it otherwise gets the ordinary attributes.
    """

    def __radd__(self, other):
        other.num_guard_conditions += 1
        return other


cdef object ONE_GUARD_CONDITION = _OneGuardCondition(0, 1)

# By the name of a file, the names of its functions that are an executor's own loops.
cdef dict OWN_LOOPS = {
    loop.__code__.co_filename: frozenset({"spin", "spin_until_future_complete"})
    for loop in (rclpy.spin, Executor.spin)
}


cdef uintptr_t handle_pointer(object handle) except? 0:
    # A handle (`rclpy.impl.rclpy_implementation`) has the attribute `pointer`: an int, the address of its
    # rcl struct, valid while the handle is entered as a context manager.
    return handle.pointer


cdef bint called_by_own_loop() except -1:
    return is_below_own_loop(sys._getframe())


cpdef bint is_below_own_loop(frame) except -1:
    # Assumes that all frames between an executor's loop and the waitable are of the files in OWN_LOOPS.
    # Where that does not hold, it is False: the executor then wakes for each message, as for a subscription.
    while frame is not None:
        code = frame.f_code
        loops = OWN_LOOPS.get(code.co_filename)
        if loops is None:
            return False
        if code.co_name in loops:
            return True
        frame = frame.f_back
    return False


def one_guard_condition():
    """The number of entities that is added in each round; for tests."""
    return ONE_GUARD_CONDITION
