# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Names, headers and messages of transforms, read into the structs of the core."""

# Layouts of the classes below, None before load_layouts() has run.
cdef Layout header_layout, vector3_layout, quaternion_layout, transform_layout
cdef Layout transform_stamped_layout
cdef int load_layouts() except -1

# The UTF-8 of a name, owned by `name`. TypeError, which names the argument; UnicodeEncodeError (lone
# surrogate) or ValueError (NUL).
cdef const char* name_utf8(object name, Py_ssize_t* size, str argument=*) except NULL
cdef const char* authority_utf8(object authority, Py_ssize_t* size) except NULL

# For log lines: the name, which is UTF-8; only the beginning of a long one, and its size in bytes.
cdef str name_for_log(const char* text, size_t size)

# `keep` receives a reference to every object that `out` points into. If it is None, the caller must hold
# `message` and run no Python code while it uses `out`.
cdef int read_transform_stamped(object message, Incoming* out, list keep) except -1
# A Transform, or the `transform` of a TransformStamped. As in tf2, a rotation whose squared length is below
# the epsilon of a double, and so also a zero one, means no rotation. ValueError if it is not finite.
cdef int read_transform(object message, Transform* out) except -1
cdef int read_any_rotation(object message, Transform* out) except -1   # the same, not normalized
cdef object new_header(int64_t stamp_ns, object frame_id)
