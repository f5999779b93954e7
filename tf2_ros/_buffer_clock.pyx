# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Read the clock of a buffer, and notice that it was set back.

Lookups that fail and waits that end read the clock. One of rclpy's is read without running code in Python,
where signal handlers run: what a handler raises could not be told from an error of the clock, but must reach
the program.
"""

from libc.stdint cimport int64_t, uint64_t

from tf2_py._internal cimport ClockHook, ClockReading, monotonic_ns, nanoseconds, system_ns

from tf2_ros_cython import _ros_presence

if _ros_presence.HAS_ROS:
    from rclpy.exceptions import InvalidHandle
    from tf2_ros._rclpy import clock_in_c
else:
    from tf2_ros._without_ros import InvalidHandle, clock_in_c

cdef str SHOWN = "the time of the buffer's clock"
JUMP_BACK_NS = 1000000000       # a clock that is set back this far clears the buffer
# A step of system time may look shorter by the time between the readings of two clocks.
cdef int64_t SYSTEM_JUMP_NS = 900000000


cdef class BufferClock(ClockHook):
    """
    The clock of a buffer.

    :param clock: one of rclpy's, or any object whose ``now()`` returns a time.
    :param reports_jumps: while it simulates time, it reports to the buffer that this jumps.
    """

    cdef readonly object clock
    cdef object _handle                     # its part in C++, if that must be asked for the time
    cdef bint _is_ros, _is_steady           # which of rclpy's clocks it is; neither: that of the system
    cdef bint _reports_jumps
    # What it showed last, and the steady time after that, in nanoseconds.
    cdef uint64_t _readings                 # 0: it has shown nothing yet
    cdef int64_t _shown_ns, _steady_ns

    def __init__(self, clock, bint reports_jumps=False):
        self.clock, self._reports_jumps = clock, reports_jumps
        in_c = clock_in_c(clock)
        self.runs_code = in_c is None
        if in_c is not None:
            self._is_ros, self._is_steady, self._handle = in_c
        if reports_jumps and not self.runs_code:
            # As if system time was read now, so that the first reading notices a step since.
            self._readings, self._shown_ns, self._steady_ns = 1, system_ns(), monotonic_ns()

    cdef bint read(self, buffer, ClockReading* reading) except -1:
        cdef uint64_t readings = self._readings
        cdef int64_t before_ns = monotonic_ns()
        cdef bint is_simulated = False
        cdef int64_t passed_ns, limit_ns
        if self.runs_code:
            reading.now_ns = nanoseconds(self.clock.now(), SHOWN)
        else:
            try:
                reading.now_ns = self._read_in_c(&is_simulated)
            except InvalidHandle:           # an AsyncNode has ended, and its clock with it
                reading.now_ns, reading.is_system = system_ns(), True
                return False
        reading.is_system = not (self.runs_code or is_simulated or self._is_steady)
        if self._is_steady or (is_simulated and self._reports_jumps):
            return False
        # If another thread has read the clock meanwhile, its reading may be the later one.
        if self._readings == readings:
            passed_ns = before_ns - self._steady_ns if reading.is_system else 0
            limit_ns = SYSTEM_JUMP_NS if reading.is_system else JUMP_BACK_NS
            is_back = readings and self._shown_ns + passed_ns - reading.now_ns >= limit_ns
            self._readings += 1
            self._shown_ns, self._steady_ns = reading.now_ns, monotonic_ns()
            if is_back and buffer._tf2_sources.has_any:
                buffer._tf2_jumped_back()
        return True

    cdef int64_t now_ns(self) except? -1:
        cdef bint is_simulated = False
        if self.runs_code:
            shown = self.clock.now()
            try:
                return nanoseconds(shown, SHOWN)
            except (TypeError, ValueError, OverflowError):
                return 0                    # a mock's
        try:
            return self._read_in_c(&is_simulated)
        except InvalidHandle:
            return 0

    cdef int64_t _read_in_c(self, bint* is_simulated) except? -1:
        # Calls functions of C and C++ only.
        if self._handle is None:
            return system_ns()
        self._handle.__enter__()
        try:
            is_simulated[0] = self._is_ros and self._handle.get_ros_time_override_is_enabled()
            return self._handle.get_now().nanoseconds
        finally:
            self._handle.__exit__(None, None, None)
