# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Make messages of transforms, and use those again that nobody has kept."""

cdef object new_transform_stamped(const Transform* transform, int64_t stamp_ns, object frame_id,
                                  object child_frame_id)
