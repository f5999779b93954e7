"""The parts of geometry messages, to and from C doubles: vectors, poses, covariances, headers."""

from tf2_py._internal cimport Layout, Transform

# Layouts of classes of geometry_msgs, ready as soon as this module is imported.
cdef Layout point_layout, point32_layout, vector3_layout, quaternion_layout, pose_layout

# A field by its name, which the layout must have (LookupError otherwise).
# All functions that read a message raise a TypeError that names the expected class if it is of another one.
cdef object get_field(Layout layout, object message, str name)
# Only for a message of `layout.new()`, once for each of its fields.
cdef int set_field(Layout layout, object message, str name, object value) except -1
# A new message with the very same field objects.
cdef object copy_shallow(Layout layout, object message)
# The first `count` fields.
cdef int read_doubles(Layout layout, object message, double* out, int count) except -1
# The orientation is normalised; as in tf2, zero length means no rotation.
cdef int read_pose(object pose, Transform* out) except -1
cdef int read_orientation(object quaternion, double* out) except -1
# `side` x `side` doubles, row by row, from anything that NumPy converts to that many numbers.
cdef int read_covariance(object covariance, int side, double* out) except -1
# The target frame of a TransformStamped, and a header for results: that frame and the transform's stamp.
cdef object target_frame(object transform)
cdef object target_header(object transform)

# -q and q are the same rotation; messages get the one with w >= 0.
cdef object new_orientation(const double* q)
cdef object new_pose(const Transform* pose)
cdef object new_covariance(const double* values, int side)
# A new array, so that changing one message does not change the other.
cdef object copied_covariance(object covariance, int side)


# Points, vectors, poses and covariances transformed into another frame, for the types made of them.

cdef Layout pose_stamped_layout

# New parts of messages; `transform` leads from the frame of what is read to the frame of what is made.
cdef object transformed_point(object point, const Transform* transform)
cdef object rotated_vector(object vector, const Transform* transform)      # rotated, not moved
cdef object transformed_pose(object pose, const Transform* transform)
cdef object transformed_pose_with_covariance(object pose, const Transform* transform)
# A message of two fields: the header for results of a TransformStamped, and `content` in the field `name`.
cdef object stamped(Layout layout, str name, object content, object transform)


# Rotated covariances: 3x3 matrices on C doubles, row by row.

cdef inline void matrix_sandwich(const double* r, const double* c, double* out) noexcept nogil:
    # out = r c r^T.
    cdef double half[9]
    cdef int i, j
    for i in range(3):
        for j in range(3):
            half[3 * i + j] = r[3 * i] * c[j] + r[3 * i + 1] * c[3 + j] + r[3 * i + 2] * c[6 + j]
    for i in range(3):
        for j in range(3):
            out[3 * i + j] = (
                half[3 * i] * r[3 * j] + half[3 * i + 1] * r[3 * j + 1] + half[3 * i + 2] * r[3 * j + 2]
            )


cdef inline void covariance_rotate(const double* r, const double* c, int side, double* out) noexcept nogil:
    # Each 3x3 block b of the `side` x `side` matrix c becomes r b r^T. Rounding must not cost the symmetry
    # that filters rely on. r b r^T and (r b^T r^T)^T are equal except for rounding; with their mean, the
    # result of a transposed block is the transposed result, bit by bit.
    cdef double block[9]
    cdef double transposed[9]
    cdef double straight[9]
    cdef double mirrored[9]
    cdef int row, column, i, j
    for row in range(0, side, 3):
        for column in range(0, side, 3):
            for i in range(3):
                for j in range(3):
                    block[3 * i + j] = c[side * (row + i) + column + j]
                    transposed[3 * j + i] = block[3 * i + j]
            matrix_sandwich(r, block, straight)
            matrix_sandwich(r, transposed, mirrored)
            for i in range(3):
                for j in range(3):
                    out[side * (row + i) + column + j] = 0.5 * straight[3 * i + j] + 0.5 * mirrored[3 * j + i]
