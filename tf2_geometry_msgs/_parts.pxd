"""The parts of geometry messages, to and from C doubles: vectors, poses, covariances, headers."""

from tf2_py._internal cimport Layout, Transform

# Layouts of the classes of geometry_msgs, ready once this module is imported.
cdef Layout point_layout, point32_layout, vector3_layout, quaternion_layout, pose_layout

# A field by its name, one of those that the layout was made with (LookupError for another).
# All that read a message raise a TypeError that names the message wanted, where it is another one.
cdef object get_field(Layout layout, object message, str name)
# Only for a message of `layout.new()`, once for each of its fields.
cdef int set_field(Layout layout, object message, str name, object value) except -1
# A new message with the very same field objects.
cdef object copy_shallow(Layout layout, object message)
# The first `count` fields.
cdef int read_doubles(Layout layout, object message, double* out, int count) except -1
# The orientation normalised; as in tf2, one of zero length counts as no rotation at all.
cdef int read_pose(object pose, Transform* out) except -1
cdef int read_orientation(object quaternion, double* out) except -1
# `side` x `side` doubles, row by row, from anything that NumPy takes for that many numbers.
cdef int read_covariance(object covariance, int side, double* out) except -1
# The target frame of a TransformStamped, and a header for results: that frame and the transform's stamp.
cdef object target_frame(object transform)
cdef object target_header(object transform)

# Of -q and q, the same rotation, a message gets the one with w >= 0.
cdef object new_orientation(const double* q)
cdef object new_pose(const Transform* pose)
cdef object new_covariance(const double* values, int side)
# Its own array, so that neither message changes with the other.
cdef object copied_covariance(object covariance, int side)
