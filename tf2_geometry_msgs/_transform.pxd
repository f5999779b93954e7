"""Points, vectors, poses and covariances carried into another frame, for the types made of them."""

from tf2_py._core.types cimport Transform
from tf2_py._objects.messages cimport Layout

cdef Layout pose_stamped_layout

# New parts of messages; `transform` leads from the frame of what is read to the frame of what is made.
cdef object carried_point(Layout layout, object point, const Transform* transform)
cdef object carried_vector(object vector, const Transform* transform)      # turned, not moved
cdef object carried_pose(object pose, const Transform* transform)
cdef object carried_pose_with_covariance(object pose, const Transform* transform)
# A message of two fields: the header that a TransformStamped gives to results, and `content` by its name.
cdef object stamped(Layout layout, str name, object content, object transform)
