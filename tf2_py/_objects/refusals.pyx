"""Owns what a broadcaster asks of transforms: whether every buffer refuses them, and why."""

from libc.stdint cimport uint32_t

from tf2_py._core.tree cimport incoming_refusals
from tf2_py._core.types cimport Incoming
from tf2_py._objects.frame_names cimport name_for_log
from tf2_py._objects.messages cimport is_exact_transform_stamped, read_transform_stamped

from tf2_py._objects.log import refusal


cdef str refusal_text(Incoming* incoming):
    cdef uint32_t reasons = incoming_refusals(incoming)
    if not reasons:
        return None
    return refusal(
        reasons,
        "buffers refuse",
        name_for_log(incoming.parent, incoming.parent_size),
        name_for_log(incoming.child, incoming.child_size),
    )


cdef str _refusal(object transform):
    cdef Incoming incoming
    cdef list keep = []
    read_transform_stamped(transform, &incoming, keep)
    return refusal_text(&incoming)


def raise_refused(list transforms):
    """
    Raise if one of these would be refused by every buffer.

    :param transforms: objects with the fields of a ``geometry_msgs/TransformStamped``.
    :raises ValueError: one would be refused; the text names its frames and the reasons.
    :raises TypeError, OverflowError: as ``BufferCore.set_transform``.
    """
    for transform in transforms:
        text = _refusal(transform)
        if text is not None:
            raise ValueError(text)


def refused(list transforms):
    """
    Those of these transforms that every buffer refuses.

    :param transforms: a list; what has a part that is not of its exact class is not looked at.
    :return: a list of pairs: the ``child_frame_id``, and the text of the error of :func:`raise_refused`.
    """
    cdef list found = []
    for transform in transforms:
        if is_exact_transform_stamped(transform):
            try:
                text = _refusal(transform)
            except ValueError as error:     # an invalid name: a NUL, or a lone surrogate
                text = str(error)
            if text is not None:
                found.append((transform.child_frame_id, text))
    return found
