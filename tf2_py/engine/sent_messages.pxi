# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What broadcasters send: serialize it as ROS does, and say which transforms every buffer refuses."""

cdef inline bint _is_exact_class(Layout layout, object message):
    return layout.by_slot and type(message) is layout.message_class


cdef bint _is_exact_transform_stamped(object message) except -1:
    # Whether all parts are exactly of rosidl's classes, with fields of the exact types, and a stamp whose
    # nanoseconds are below a second. Only then does read_transform_stamped read everything in the message.
    load_layouts()
    if not _is_exact_class(transform_stamped_layout, message):
        return False
    header = transform_stamped_layout.get(message, STAMPED_HEADER)
    transform = transform_stamped_layout.get(message, STAMPED_TRANSFORM)
    if not (_is_exact_class(header_layout, header) and _is_exact_class(transform_layout, transform)):
        return False
    stamp = header_layout.get(header, HEADER_STAMP)
    if not _is_exact_class(time_layout, stamp):
        return False
    sec, nanosec = time_layout.get(stamp, TIME_SEC), time_layout.get(stamp, TIME_NANOSEC)
    return (type(sec) is int and -0x80000000 <= sec < 0x80000000
            and type(nanosec) is int and 0 <= nanosec < NS_PER_S
            and type(header_layout.get(header, HEADER_FRAME_ID)) is str
            and type(transform_stamped_layout.get(message, STAMPED_CHILD_FRAME_ID)) is str
            and _is_exact_class(vector3_layout, transform_layout.get(transform, TRANSFORM_TRANSLATION))
            and _is_exact_class(quaternion_layout, transform_layout.get(transform, TRANSFORM_ROTATION)))


cdef str _refusal_text(Incoming* incoming):
    cdef uint32_t reasons = incoming_refusals(incoming)
    if not reasons:
        return None
    return log.refusal(
        reasons,
        "buffers refuse",
        name_for_log(incoming.parent, incoming.parent_size),
        name_for_log(incoming.child, incoming.child_size),
    )


def refused_transforms(list transforms):
    """
    The transforms that every buffer refuses.

    :param transforms: a list of ``geometry_msgs/TransformStamped``.
    :return: a list of pairs: the ``child_frame_id``, and why.
    """
    cdef Incoming incoming
    cdef list keep = []
    cdef list found = []
    for transform in transforms:
        try:
            read_transform_stamped(transform, &incoming, keep)
            text = _refusal_text(&incoming)
        except (OverflowError, TypeError, ValueError) as error:
            text = str(error)
        if text is not None:
            found.append((transform.child_frame_id, text))
    return found


def serialize_as_ros(list transforms):
    """
    The ``tf2_msgs/TFMessage`` of these transforms as plain CDR, ready for a publisher.

    :param transforms: a list of ``geometry_msgs/TransformStamped``.
    :return: the bytes, and the transforms that every buffer refuses, as pairs of ``child_frame_id`` and
        reason. Numbers of any type are sent as floats. None if a part of one is not exactly of its class but,
        for example, of a subclass: then ROS's own conversion decides.
    """
    cdef Batch batch
    cdef size_t i
    cdef list keep = []
    cdef list refused = []
    for transform in transforms:
        if not _is_exact_transform_stamped(transform):
            return None
    memset(&batch, 0, sizeof(Batch))
    if batch_reserve(&batch, len(transforms)) != 0:
        raise MemoryError
    try:
        batch.count = len(transforms)
        for i in range(batch.count):
            try:
                read_transform_stamped(transforms[i], &batch.entries[i].incoming, keep)
            except (OverflowError, TypeError, ValueError):  # what is no number; a lone surrogate
                return None
        data = batch_cdr(&batch)
        # After writing, because asking for the refusals changes the names and the rotation.
        for i in range(batch.count):
            text = _refusal_text(&batch.entries[i].incoming)
            if text is not None:
                refused.append((transforms[i].child_frame_id, text))
        return data, refused
    finally:
        batch_free(&batch)
