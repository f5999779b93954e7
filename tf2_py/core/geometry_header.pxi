# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Vector and quaternion maths on C doubles: 3-vectors x y z, quaternions x y z w."""

cdef extern from *:
    """
    /* 1 - |a . b| up to which interpolation_weights are exact to the last digits: a turn of 28 degrees. */
    #define TF2_FAR_APART 0.03
    """
    const double FAR_APART "TF2_FAR_APART"


cdef inline void quaternion_multiply(const double* a, const double* b, double* out) noexcept nogil:
    # out = a b: rotates by b first. `out` may be `a` or `b`.
    cdef double x = a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1]
    cdef double y = a[3] * b[1] + a[1] * b[3] + a[2] * b[0] - a[0] * b[2]
    cdef double z = a[3] * b[2] + a[2] * b[3] + a[0] * b[1] - a[1] * b[0]
    cdef double w = a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2]
    out[0] = x
    out[1] = y
    out[2] = z
    out[3] = w


cdef inline void vector_rotate(const double* q, const double* v, double* out) noexcept nogil:
    # out = q v q*, for unit q, as v + 2 u x (u x v + w v) with u = (x, y, z). `out` may be `v`.
    cdef double tx = 2.0 * (q[1] * v[2] - q[2] * v[1])
    cdef double ty = 2.0 * (q[2] * v[0] - q[0] * v[2])
    cdef double tz = 2.0 * (q[0] * v[1] - q[1] * v[0])
    cdef double x = v[0] + q[3] * tx + (q[1] * tz - q[2] * ty)
    cdef double y = v[1] + q[3] * ty + (q[2] * tx - q[0] * tz)
    cdef double z = v[2] + q[3] * tz + (q[0] * ty - q[1] * tx)
    out[0] = x
    out[1] = y
    out[2] = z


cdef inline double vector_length(const double* v) noexcept nogil:
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


cdef inline void quaternion_conjugate(const double* q, double* out) noexcept nogil:
    out[0] = -q[0]
    out[1] = -q[1]
    out[2] = -q[2]
    out[3] = q[3]


cdef inline bint quaternion_normalize(double* q) noexcept nogil:
    # Returns False and leaves q unchanged if the squared norm is infinite, NaN, or so small that digits are
    # lost.
    cdef double squared = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    cdef double scale
    if not DBL_MIN <= squared <= DBL_MAX:
        return False
    scale = 1.0 / sqrt(squared)
    q[0] *= scale
    q[1] *= scale
    q[2] *= scale
    q[3] *= scale
    return True


cdef inline bint quaternion_normalize_once(double* q, double* squared_length) noexcept nogil:
    # The same as quaternion_normalize, except that a quaternion that it has normalized before remains
    # identical to the last bit. Its rounding errors add up to at most 14 half units in the last place of the
    # squared length. That is summed in the order of tf2, so that is_unnormalized agrees to the last bit.
    cdef double squared = q[3] * q[3] + q[0] * q[0] + q[1] * q[1] + q[2] * q[2]
    squared_length[0] = squared
    return fabs(squared - 1.0) <= 2e-15 or quaternion_normalize(q)


cdef inline bint is_unnormalized(double squared_length) noexcept nogil:
    # Whether tf2 of Kilted and later refuses a rotation that can be normalized.
    return fabs(squared_length - 1.0) >= 0.01


cdef inline bint quaternion_normalize_any(double* q) noexcept nogil:
    # Accepts every finite length above zero. For other lengths, returns False and leaves q unchanged.
    cdef double largest = 0.0
    cdef int i
    if quaternion_normalize(q):
        return True
    for i in range(4):
        if not isfinite(q[i]):
            return False
        largest = max(largest, fabs(q[i]))
    if largest == 0.0:
        return False
    for i in range(4):
        q[i] /= largest
    return quaternion_normalize(q)


cdef inline double quaternion_lead(const double* q) noexcept nogil:
    # The number whose sign decides which of q and -q is canonical, as tf2 chooses when it reads a rotation
    # matrix: w > 0 if the matrix has a positive trace (4 w^2 - 1); otherwise the largest of x, y, z is
    # positive, the first of equals.
    cdef double lead
    if 4.0 * q[3] * q[3] > 1.0:
        return q[3]
    lead = q[0]
    if fabs(q[1]) > fabs(lead):
        lead = q[1]
    if fabs(q[2]) > fabs(lead):
        lead = q[2]
    return lead


cdef inline void quaternion_canonicalize(double* q) noexcept nogil:
    if quaternion_lead(q) < 0.0:
        q[0] = -q[0]
        q[1] = -q[1]
        q[2] = -q[2]
        q[3] = -q[3]


cdef inline double sinc_series(double squared) noexcept nogil:
    # sin(x) / x from x^2; its first omitted term is below 3e-17 for squared <= 0.0625.
    return 1.0 + squared * (-1.0 / 6.0 + squared * (1.0 / 120.0 + squared * (
        -1.0 / 5040.0 + squared * (1.0 / 362880.0 + squared * (-1.0 / 39916800.0)))))


# The interpolation of rotations, of single lookups and of series: shortest-path slerp (Shoemake 1985), whose
# weights are sin((1 - r) t) / sin(t) and sin(r t) / sin(t), where cos(t) = |a . b|. Neighboring samples are
# mostly close; only others need the trigonometric functions. So there are two functions, of which series call
# the first one for many times at once: it has no branches, and takes numbers, not pointers.

cdef inline double interpolation_weights(double ax, double ay, double az, double aw, double bx, double by,
                                         double bz, double bw, double ratio, double* sign, double* weight_a,
                                         double* weight_b) noexcept nogil:
    # Computes the weights of the unit quaternions a and b at `ratio` between them, and returns their
    # distance, 1 - |a . b| without cancellation. Above FAR_APART, only far_interpolation_weights is exact.
    # With cos(t) = 1 - d, t^2 is a short series in d (t^2 = 2 sum (2 d)^n / (n^2 C(2n, n))), and the sines
    # are short series in t^2.
    cdef double dot = ax * bx + ay * by + az * bz + aw * bw
    sign[0] = 1.0 if dot >= 0.0 else -1.0
    cdef double dx = sign[0] * bx - ax
    cdef double dy = sign[0] * by - ay
    cdef double dz = sign[0] * bz - az
    cdef double dw = sign[0] * bw - aw
    cdef double distance = 0.5 * (dx * dx + dy * dy + dz * dz + dw * dw)
    cdef double squared = distance * (2.0 + distance * (1.0 / 3.0 + distance * (4.0 / 45.0 + distance * (
        1.0 / 35.0 + distance * (16.0 / 1575.0 + distance * (8.0 / 2079.0 + distance * (32.0 / 21021.0)))))))
    cdef double rest = 1.0 - ratio
    cdef double scale = 1.0 / sinc_series(squared)
    weight_a[0] = rest * sinc_series(rest * rest * squared) * scale
    weight_b[0] = sign[0] * (ratio * sinc_series(ratio * ratio * squared) * scale)
    return distance


cdef inline void far_interpolation_weights(double distance, double ratio, double sign, double* weight_a,
                                           double* weight_b) noexcept nogil:
    # The sine of the rest is that of a difference, so that one angle needs its sine and cosine.
    cdef double cosine = 1.0 - distance
    cdef double sine = sqrt(distance * (1.0 + cosine))
    cdef double angle = ratio * acos(cosine)
    cdef double part = sin(angle) / sine
    weight_a[0] = cos(angle) - cosine * part
    weight_b[0] = sign * part


cdef inline void quaternion_interpolate(const double* a, const double* b, double ratio,
                                        double* out) noexcept nogil:
    cdef double sign, weight_a, weight_b
    cdef double distance = interpolation_weights(a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3], ratio, &sign,
                                                 &weight_a, &weight_b)
    if distance > FAR_APART:
        far_interpolation_weights(distance, ratio, sign, &weight_a, &weight_b)
    out[0] = weight_a * a[0] + weight_b * b[0]
    out[1] = weight_a * a[1] + weight_b * b[1]
    out[2] = weight_a * a[2] + weight_b * b[2]
    out[3] = weight_a * a[3] + weight_b * b[3]


# Rotation vectors: an axis times an angle in radians.

cdef inline void rotation_vector(const double* q, double* out) noexcept nogil:
    # Of a unit quaternion (v, w), at most pi: 2 atan2(|v|, |w|) v / |v|, with the sign of w.
    cdef double sine = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    cdef double scale = 2.0 * atan2(sine, fabs(q[3])) / sine if sine > 0.0 else 2.0
    cdef int i
    if q[3] < 0.0:
        scale = -scale
    for i in range(3):
        out[i] = scale * q[i]


cdef inline void rotation_vector_between(const double* a, const double* b, double* out) noexcept nogil:
    # The turn a^-1 b, in the axes of a.
    cdef double turn[4]
    quaternion_conjugate(a, turn)
    quaternion_multiply(turn, b, turn)
    rotation_vector(turn, out)


cdef inline void quaternion_turn(const double* q, const double* vector, double factor,
                                 double* out) noexcept nogil:
    # out = q exp(factor vector): turned about an axis that is given in its own axes. `out` may be `q`.
    cdef double turn[4]
    cdef double half = 0.5 * factor * sqrt(
        vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])
    cdef double scale = 0.5 * factor * (sin(half) / half if fabs(half) > 1e-8 else 1.0)
    turn[0] = scale * vector[0]
    turn[1] = scale * vector[1]
    turn[2] = scale * vector[2]
    turn[3] = cos(half)
    quaternion_multiply(q, turn, out)


cdef inline void transform_identity(Transform* out) noexcept nogil:
    out.translation[0] = out.translation[1] = out.translation[2] = 0.0
    out.rotation[0] = out.rotation[1] = out.rotation[2] = 0.0
    out.rotation[3] = 1.0


cdef inline void transform_compose(const Transform* a, const Transform* b, Transform* out) noexcept nogil:
    # out = a b: applies b first. `out` may be `a` or `b`.
    cdef double moved[3]
    vector_rotate(a.rotation, b.translation, moved)
    out.translation[0] = moved[0] + a.translation[0]
    out.translation[1] = moved[1] + a.translation[1]
    out.translation[2] = moved[2] + a.translation[2]
    quaternion_multiply(a.rotation, b.rotation, out.rotation)


cdef inline void transform_between(const Transform* target, const Transform* source,
                                   Transform* out) noexcept nogil:
    # out = target^-1 source: from `source`'s child to `target`'s child, both given in one frame.
    cdef double inverse[4]
    cdef double apart[3]
    quaternion_conjugate(target.rotation, inverse)
    apart[0] = source.translation[0] - target.translation[0]
    apart[1] = source.translation[1] - target.translation[1]
    apart[2] = source.translation[2] - target.translation[2]
    vector_rotate(inverse, apart, out.translation)
    quaternion_multiply(inverse, source.rotation, out.rotation)


cdef inline void matrix_from_quaternion(const double* q, double* out) noexcept nogil:
    # The 3x3 matrix, row by row, of a unit quaternion; J. Diebel, Representing Attitude, 2006.
    cdef double xx = q[0] * q[0]
    cdef double yy = q[1] * q[1]
    cdef double zz = q[2] * q[2]
    cdef double xy = q[0] * q[1]
    cdef double xz = q[0] * q[2]
    cdef double yz = q[1] * q[2]
    cdef double wx = q[3] * q[0]
    cdef double wy = q[3] * q[1]
    cdef double wz = q[3] * q[2]
    out[0] = 1.0 - 2.0 * (yy + zz)
    out[1] = 2.0 * (xy - wz)
    out[2] = 2.0 * (xz + wy)
    out[3] = 2.0 * (xy + wz)
    out[4] = 1.0 - 2.0 * (xx + zz)
    out[5] = 2.0 * (yz - wx)
    out[6] = 2.0 * (xz - wy)
    out[7] = 2.0 * (yz + wx)
    out[8] = 1.0 - 2.0 * (xx + yy)


cdef inline void matrix_from_transform(const Transform* transform, double* out) noexcept nogil:
    # The homogeneous 4x4 matrix, row by row; NaN throughout if the rotation is.
    cdef double turn[9]
    cdef bint is_nan = isnan(transform.rotation[3])
    cdef int row
    matrix_from_quaternion(transform.rotation, turn)
    for row in range(3):
        out[4 * row] = turn[3 * row]
        out[4 * row + 1] = turn[3 * row + 1]
        out[4 * row + 2] = turn[3 * row + 2]
        out[4 * row + 3] = transform.translation[row]
    out[12] = out[13] = out[14] = NAN if is_nan else 0.0
    out[15] = NAN if is_nan else 1.0


# Mean twists: between two poses, and of a point of the moving body.

cdef inline void twist_between(const Transform* start, const Transform* end, double seconds, double* linear,
                               double* angular) noexcept nogil:
    # Meters and radians per second, of the moving origin, in the frame that both poses are given in:
    # the chord between the origins, and the rotation vector of end start^-1, each over the time.
    # Zero seconds: NaN.
    cdef double turn[4]
    cdef int i
    quaternion_conjugate(start.rotation, turn)
    quaternion_multiply(end.rotation, turn, turn)
    rotation_vector(turn, angular)
    for i in range(3):
        linear[i] = (end.translation[i] - start.translation[i]) / seconds
        angular[i] /= seconds


cdef inline void twist_of_point(const Transform* start, const Transform* end, double seconds,
                                const Transform* middle, const Transform* point_frame, const double* point,
                                const Transform* reference, double* linear, double* angular) noexcept nogil:
    # The mean twist of a body in an observation frame, of the point of the body that is at `point`, in the
    # axes of a reference frame. Meters and radians per second.
    # `start`, `end`, `middle`: the body in the observation frame, `seconds` apart and at the time asked for.
    # `point`: x y z in meters in the point frame; `point_frame`: that frame in the observation frame.
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


cdef inline void twist_interval(int64_t time_ns, int64_t interval_ns, int64_t common_ns,
                                int64_t* start_ns, int64_t* end_ns) noexcept nogil:
    # From when to when the mean twist around a time, which is at least 1, is taken. Neither is 0, "latest".
    # After the latest common time, only a frame with several parents has answers; its interval ends at the
    # time, and if that has no answer, there is no twist.
    cdef int64_t after_ns = interval_ns - interval_ns // 2
    start_ns[0] = max(time_ns - interval_ns // 2, 1)
    end_ns[0] = time_ns + min(after_ns, INT64_MAX - time_ns)
    if common_ns and end_ns[0] > common_ns:
        end_ns[0] = max(common_ns, time_ns)
