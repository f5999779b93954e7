"""ROS message objects and the structs of the engine, in both directions."""

from libc.stdint cimport int64_t

from tf2_py._core.types cimport Incoming, Transform
from tf2_py._objects.layout cimport Layout

# Layouts of the classes below, None before load() has run.
cdef Layout header_layout, vector3_layout, quaternion_layout, transform_layout
cdef Layout transform_stamped_layout
cdef int load() except -1

# The UTF-8 of a name, owned by `name`. TypeError, UnicodeEncodeError (lone surrogate) or ValueError (NUL).
cdef const char* name_utf8(object name, Py_ssize_t* size) except NULL
cdef const char* authority_utf8(object authority, Py_ssize_t* size) except NULL

# `keep`, where not None, is given a reference to every object that `out` points into; where it is None
# the caller holds `message` and runs no Python code while it uses `out`.
cdef int read_transform_stamped(object message, Incoming* out, list keep) except -1
# Whether all parts are of rosidl's classes themselves, with fields of the exact types, and a stamp whose
# nanoseconds are below a second. Only then does read_transform_stamped read all that the message holds.
cdef bint is_exact_transform_stamped(object message) except -1
# A Transform, or the `transform` of a TransformStamped. As in tf2, a rotation whose squared length is below a
# double's epsilon, so also a zero one, counts as none. ValueError where it is not finite.
cdef int read_transform(object message, Transform* out) except -1
cdef int read_any_rotation(object message, Transform* out) except -1   # the same, not normalised
cdef object new_header(int64_t stamp_ns, object frame_id)
cdef object new_transform_stamped(const Transform* transform, int64_t stamp_ns, object frame_id,
                                  object child_frame_id)
