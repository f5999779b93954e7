"""Owns the serialising of the messages that broadcasters send."""

from cpython.bytes cimport PyBytes_AS_STRING, PyBytes_FromStringAndSize
from libc.stddef cimport size_t
from libc.string cimport memset

from tf2_py._objects.messages cimport is_exact_transform_stamped, read_transform_stamped
from tf2_py._objects.refusals cimport refusal_text
from tf2_py._wire.batch cimport Batch, batch_free, batch_reserve
from tf2_py._wire.cdr cimport Writer, writer_init, writer_transform


def serialize_transforms(list transforms):
    """
    The ``tf2_msgs/TFMessage`` of these transforms as plain CDR, ready for a publisher.

    :param transforms: a list of ``geometry_msgs/TransformStamped``.
    :return: the bytes, and those that every buffer refuses, as pairs: the ``child_frame_id`` and the reason.
        None where a part of one is not of its exact class, for example of a subclass: then ROS's own
        conversion decides.
    """
    cdef Batch batch
    cdef Writer writer
    cdef size_t i
    cdef list keep = []
    cdef list refused = []
    for transform in transforms:
        if not is_exact_transform_stamped(transform):
            return None
    memset(&batch, 0, sizeof(Batch))
    if batch_reserve(&batch, len(transforms)) != 0:
        raise MemoryError
    try:
        batch.count = len(transforms)
        for i in range(batch.count):
            try:
                read_transform_stamped(transforms[i], &batch.entries[i].incoming, keep)
            except ValueError:      # an invalid name: a NUL, or a lone surrogate
                return None
        writer_init(&writer, NULL, <unsigned int>batch.count)
        for i in range(batch.count):
            writer_transform(&writer, &batch.entries[i].incoming)
        data = PyBytes_FromStringAndSize(NULL, writer.position)
        writer_init(&writer, <unsigned char*>PyBytes_AS_STRING(data), <unsigned int>batch.count)
        for i in range(batch.count):
            writer_transform(&writer, &batch.entries[i].incoming)
        # After writing, because asking for the refusals changes the names and the rotation.
        for i in range(batch.count):
            text = refusal_text(&batch.entries[i].incoming)
            if text is not None:
                refused.append((transforms[i].child_frame_id, text))
        return data, refused
    finally:
        batch_free(&batch)
