"""The mean twist between two poses."""

from libc.math cimport atan2, sqrt

from tf2_py._core.geometry cimport quaternion_conjugate, quaternion_multiply
from tf2_py._core.types cimport Transform


cdef inline void twist_between(const Transform* start, const Transform* end, double seconds,
                               double* linear, double* angular) noexcept nogil:
    # Metres and radians per second, of the moving origin, in the frame that both poses are given in:
    # the chord between the origins, and the rotation vector of end start^-1, each over the time.
    # The rotation vector is 2 atan2(|v|, w) v / |v| for the quaternion (v, w) with w >= 0. Zero seconds: NaN.
    cdef double inverse[4]
    cdef double turn[4]
    cdef double sine, scale
    cdef int i
    quaternion_conjugate(start.rotation, inverse)
    quaternion_multiply(end.rotation, inverse, turn)
    if turn[3] < 0.0:
        for i in range(4):
            turn[i] = -turn[i]
    sine = sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])
    scale = 2.0 * atan2(sine, turn[3]) / sine if sine > 0.0 else 2.0
    for i in range(3):
        linear[i] = (end.translation[i] - start.translation[i]) / seconds
        angular[i] = scale * turn[i] / seconds
