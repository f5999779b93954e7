# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The parts of geometry messages, to and from C doubles: vectors, poses, covariances, headers."""

from tf2_py._internal cimport Layout, Transform

# Layouts of classes of geometry_msgs, ready as soon as this module is imported.
cdef Layout vector3_layout, quaternion_layout

# A field by its name, which the layout must have (LookupError otherwise).
# All functions that read a message raise a TypeError that names the expected class if it is of another one.
cdef object get_field(Layout layout, object message, str name)
# Only for a message of `layout.new()`, once for each of its fields.
cdef int set_field(Layout layout, object message, str name, object value) except -1
# A new message with the very same field objects.
cdef object copy_shallow(Layout layout, object message)
# The first `count` fields.
cdef int read_doubles(Layout layout, object message, double* out, int count) except -1
# Normalized; as in tf2, zero length means no rotation.
cdef int read_orientation(object quaternion, double* out, str field) except -1
# The target frame of a TransformStamped, and a header for results: that frame and the transform's stamp.
cdef object target_frame(object transform)
cdef object target_header(object transform)

# -q and q are the same rotation; messages get the one with w >= 0.
cdef object new_orientation(const double* q)
# `side` x `side` numbers, row by row, of anything that NumPy converts to that many. A new array, so that
# changing one message does not change the other.
cdef object copied_covariance(object covariance, int side)


# Points, vectors, poses and covariances transformed into another frame, for the types made of them.

cdef Layout pose_stamped_layout

# New parts of messages; `transform` leads from the frame of what is read to the frame of what is made.
cdef object rotated_vector(object vector, const Transform* transform)      # rotated, not moved
cdef object transformed_pose(object pose, const Transform* transform)
cdef object transformed_pose_with_covariance(object pose, const Transform* transform)
# As copied_covariance. Unchanged if it `may_be_absent`, and begins with -1.
cdef object rotated_covariance(object covariance, int side, const Transform* transform, bint may_be_absent)
# A message of two fields: the header for results of a TransformStamped, and `content` in the field `name`.
cdef object stamped(Layout layout, str name, object content, object transform)
