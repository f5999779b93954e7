"""Points, vectors, poses and covariances transformed into another frame, for the types made of them."""

from tf2_py._internal cimport Layout, Transform

cdef Layout pose_stamped_layout

# New parts of messages; `transform` leads from the frame of what is read to the frame of what is made.
cdef object transformed_point(Layout layout, object point, const Transform* transform)
cdef object rotated_vector(object vector, const Transform* transform)      # rotated, not moved
cdef object transformed_pose(object pose, const Transform* transform)
cdef object transformed_pose_with_covariance(object pose, const Transform* transform)
# A message of two fields: the header that a TransformStamped gives to results, and `content` by its name.
cdef object stamped(Layout layout, str name, object content, object transform)
