"""Vector and quaternion maths on C doubles: 3-vectors x y z, quaternions x y z w."""

from libc.float cimport DBL_MAX, DBL_MIN
from libc.math cimport acos, fabs, isfinite, sin, sqrt

from tf2_py._core.types cimport Transform

cdef extern from *:
    """
    /* 1 - |a . b| up to which slerp_weights_series is exact to the last digits: a turn of 28 degrees. */
    #define TF2_SLERP_SERIES_LIMIT 0.03
    """
    const double SLERP_SERIES_LIMIT "TF2_SLERP_SERIES_LIMIT"


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


cdef inline void quaternion_conjugate(const double* q, double* out) noexcept nogil:
    out[0] = -q[0]
    out[1] = -q[1]
    out[2] = -q[2]
    out[3] = q[3]


cdef inline bint quaternion_normalise(double* q) noexcept nogil:
    # False, and q unchanged, where the squared norm is infinite or NaN, or so small that digits are lost.
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


cdef inline bint quaternion_normalise_any(double* q) noexcept nogil:
    # For every finite length above zero. False, and q unchanged: the length is another one.
    cdef double largest = 0.0
    cdef int i
    if quaternion_normalise(q):
        return True
    for i in range(4):
        if not isfinite(q[i]):
            return False
        largest = max(largest, fabs(q[i]))
    if largest == 0.0:
        return False
    for i in range(4):
        q[i] /= largest
    return quaternion_normalise(q)


cdef inline void quaternion_canonicalise(double* q) noexcept nogil:
    # Of q and -q the one that tf2 returns when it reads a rotation matrix: w > 0 where the matrix has
    # a positive trace (4 w^2 - 1), otherwise the largest of x, y, z is positive, the first of equals.
    cdef double lead = q[3]
    if 4.0 * q[3] * q[3] <= 1.0:
        lead = q[0]
        if fabs(q[1]) > fabs(lead):
            lead = q[1]
        if fabs(q[2]) > fabs(lead):
            lead = q[2]
    if lead < 0.0:
        q[0] = -q[0]
        q[1] = -q[1]
        q[2] = -q[2]
        q[3] = -q[3]


cdef inline double sinc_series(double squared) noexcept nogil:
    # sin(x) / x from x^2; its first omitted term is below 3e-17 for squared <= 0.0625.
    return 1.0 + squared * (-1.0 / 6.0 + squared * (1.0 / 120.0 + squared * (
        -1.0 / 5040.0 + squared * (1.0 / 362880.0 + squared * (-1.0 / 39916800.0)))))


cdef inline double slerp_distance(const double* a, const double* b, double* sign) noexcept nogil:
    # 1 - |a . b| without cancellation, for unit a and b; `sign` is that of a . b.
    cdef double dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    sign[0] = 1.0 if dot >= 0.0 else -1.0
    cdef double dx = sign[0] * b[0] - a[0]
    cdef double dy = sign[0] * b[1] - a[1]
    cdef double dz = sign[0] * b[2] - a[2]
    cdef double dw = sign[0] * b[3] - a[3]
    return 0.5 * (dx * dx + dy * dy + dz * dz + dw * dw)


cdef inline void slerp_weights_series(double distance, double ratio, double* weight_a,
                                      double* weight_b) noexcept nogil:
    # For distance <= SLERP_SERIES_LIMIT. With cos(t) = 1 - d, t^2 is a short series in d
    # (t^2 = 2 sum (2 d)^n / (n^2 C(2n, n))), and the sines are short series in t^2: no acos, no sin.
    cdef double squared = distance * (2.0 + distance * (1.0 / 3.0 + distance * (4.0 / 45.0 + distance * (
        1.0 / 35.0 + distance * (16.0 / 1575.0 + distance * (8.0 / 2079.0 + distance * (32.0 / 21021.0)))))))
    cdef double rest = 1.0 - ratio
    cdef double scale = 1.0 / sinc_series(squared)
    weight_a[0] = rest * sinc_series(rest * rest * squared) * scale
    weight_b[0] = ratio * sinc_series(ratio * ratio * squared) * scale


cdef inline void slerp_weights_exact(double distance, double ratio, double* weight_a,
                                     double* weight_b) noexcept nogil:
    cdef double angle = acos(1.0 - distance)
    cdef double scale = 1.0 / sin(angle)
    weight_a[0] = sin((1.0 - ratio) * angle) * scale
    weight_b[0] = sin(ratio * angle) * scale


cdef inline void quaternion_slerp(const double* a, const double* b, double ratio, double* out) noexcept nogil:
    # Shortest-path spherical interpolation between unit quaternions (Shoemake 1985):
    # weights sin((1 - r) t) / sin(t) and sin(r t) / sin(t), where cos(t) = |a . b|.
    # Neighbouring samples are mostly close; only others need the trigonometric functions.
    cdef double sign, weight_a, weight_b
    cdef double distance = slerp_distance(a, b, &sign)
    if distance <= SLERP_SERIES_LIMIT:
        slerp_weights_series(distance, ratio, &weight_a, &weight_b)
    else:
        slerp_weights_exact(distance, ratio, &weight_a, &weight_b)
    weight_b *= sign
    out[0] = weight_a * a[0] + weight_b * b[0]
    out[1] = weight_a * a[1] + weight_b * b[1]
    out[2] = weight_a * a[2] + weight_b * b[2]
    out[3] = weight_a * a[3] + weight_b * b[3]


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


cdef inline double matrix_defect(const double* r) noexcept nogil:
    # How far a 3x3 matrix, row by row, is from an orthogonal one: the greatest part of |R R^T - 1|.
    cdef double greatest = 0.0
    cdef double product
    cdef int i, j
    for i in range(3):
        for j in range(i, 3):
            product = r[3 * i] * r[3 * j] + r[3 * i + 1] * r[3 * j + 1] + r[3 * i + 2] * r[3 * j + 2]
            greatest = max(greatest, fabs(product - 1.0 if i == j else product))
    return greatest


cdef inline double matrix_determinant(const double* r) noexcept nogil:
    return (r[0] * (r[4] * r[8] - r[5] * r[7]) + r[1] * (r[5] * r[6] - r[3] * r[8])
            + r[2] * (r[3] * r[7] - r[4] * r[6]))


cdef inline void quaternion_from_matrix(const double* r, double* q) noexcept nogil:
    # Of a rotation matrix, row by row; of length one, w >= 0. S. W. Shepperd, Quaternion from Rotation
    # Matrix, 1978: the quaternion times four times its greatest part, which loses nothing to rounding.
    cdef double trace = r[0] + r[4] + r[8]
    if trace >= r[0] and trace >= r[4] and trace >= r[8]:
        q[0] = r[7] - r[5]
        q[1] = r[2] - r[6]
        q[2] = r[3] - r[1]
        q[3] = 1.0 + trace
    elif r[0] >= r[4] and r[0] >= r[8]:
        q[0] = 1.0 + 2.0 * r[0] - trace
        q[1] = r[1] + r[3]
        q[2] = r[2] + r[6]
        q[3] = r[7] - r[5]
    elif r[4] >= r[8]:
        q[0] = r[1] + r[3]
        q[1] = 1.0 + 2.0 * r[4] - trace
        q[2] = r[5] + r[7]
        q[3] = r[2] - r[6]
    else:
        q[0] = r[2] + r[6]
        q[1] = r[5] + r[7]
        q[2] = 1.0 + 2.0 * r[8] - trace
        q[3] = r[3] - r[1]
    if q[3] < 0.0:
        q[0] = -q[0]
        q[1] = -q[1]
        q[2] = -q[2]
        q[3] = -q[3]
    quaternion_normalise(q)
