"""Mean twists: between two poses, and of a point of the moving body."""

from libc.math cimport atan2, sqrt

from tf2_py._core.geometry cimport quaternion_conjugate, quaternion_multiply, vector_rotate
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


cdef inline void twist_of_point(const Transform* start, const Transform* end, double seconds,
                                const Transform* middle, const Transform* point_frame, const double* point,
                                const Transform* reference, double* linear, double* angular) noexcept nogil:
    # The mean twist of a body in an observation frame, of the point of the body that is at `point`, in the
    # axes of a reference frame. Metres and radians per second.
    # `start`, `end`, `middle`: the body in the observation frame, `seconds` apart and at the time asked for.
    # `point`: x y z in metres in the point frame; `point_frame`: that frame in the observation frame.
    # `reference`: the observation frame in the reference frame.
    # linear = chord over the time + angular x (point - origin of the body).
    cdef double arm[3]
    cdef int i
    twist_between(start, end, seconds, linear, angular)
    vector_rotate(point_frame.rotation, point, arm)
    for i in range(3):
        arm[i] += point_frame.translation[i] - middle.translation[i]
    linear[0] += angular[1] * arm[2] - angular[2] * arm[1]
    linear[1] += angular[2] * arm[0] - angular[0] * arm[2]
    linear[2] += angular[0] * arm[1] - angular[1] * arm[0]
    vector_rotate(reference.rotation, linear, linear)
    vector_rotate(reference.rotation, angular, angular)
