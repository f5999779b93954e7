"""Owns the samples of histories as serialised TFMessages: to the last bit, neither checked nor normalised."""

from cpython.bytes cimport PyBytes_AS_STRING, PyBytes_FromStringAndSize, PyBytes_GET_SIZE
from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t
from libc.string cimport memcpy, memset

from tf2_py._core.cache_copy cimport TRANSFORM_DOUBLES
from tf2_py._core.names cimport (
    NAME_NO_MEMORY,
    NAME_UNKNOWN,
    Names,
    names_find,
    names_free,
    names_init,
    names_intern,
)
from tf2_py._core.types cimport Incoming, Transform
from tf2_py._wire.batch cimport Batch, batch_error, batch_free, batch_read_cdr
from tf2_py._wire.cdr cimport Writer, writer_init, writer_transform

from tf2_py._objects.arrays import new_array
from tf2_py._objects.printable import printable


def serialize_samples(
    list names,
    const int64_t[::1] rows,
    const uint32_t[::1] children,
    const uint32_t[::1] parents,
    const int64_t[::1] stamps,
    const double[:, ::1] transforms,
):
    """
    The ``tf2_msgs/TFMessage`` of some samples as plain CDR.

    :param names: bytes, by id from 1; the first element is not used.
    :param rows: which samples, in this order: indices into the other arrays, which have one element for each
        sample: the ids of its frame and of its parent, its stamp in ns, and its transform as in Transform.
    """
    cdef Writer writer
    cdef Incoming incoming
    cdef Py_ssize_t i
    cdef int64_t row
    cdef bytes data = None
    cdef bytes name
    writer_init(&writer, NULL, <uint32_t>rows.shape[0])
    # Once to count the bytes, once to write them.
    while True:
        for i in range(rows.shape[0]):
            row = rows[i]
            incoming.stamp_ns = stamps[row]
            name = names[children[row]]
            incoming.child, incoming.child_size = PyBytes_AS_STRING(name), PyBytes_GET_SIZE(name)
            name = names[parents[row]]
            incoming.parent, incoming.parent_size = PyBytes_AS_STRING(name), PyBytes_GET_SIZE(name)
            memcpy(&incoming.transform, &transforms[row, 0], sizeof(Transform))
            writer_transform(&writer, &incoming)
        if data is not None:
            return data
        data = PyBytes_FromStringAndSize(NULL, writer.position)
        writer_init(&writer, <unsigned char*>PyBytes_AS_STRING(data), <uint32_t>rows.shape[0])


cdef class SampleReader:
    """
    Reads samples back from messages, in their order.

    :param names: as of :func:`serialize_samples`.
    """

    cdef Names _names
    cdef Batch _batch
    cdef size_t _count
    cdef tuple _arrays      # children, parents, stamps, transforms; the first `_count` elements are in use

    def __cinit__(self):
        memset(&self._batch, 0, sizeof(Batch))
        if names_init(&self._names) != 0:
            raise MemoryError
        self._arrays = _new_arrays(1024)

    def __init__(self, list names):
        cdef bytes name
        for name in names:
            if names_intern(&self._names, PyBytes_AS_STRING(name), PyBytes_GET_SIZE(name)) == NAME_NO_MEMORY:
                raise MemoryError

    def __dealloc__(self):
        batch_free(&self._batch)
        names_free(&self._names)

    def read(self, bytes data):
        """
        Add the transforms of one message.

        :raises ValueError: it is malformed, or names a frame that is not among the names.
        """
        cdef uint32_t[::1] children, parents
        cdef int64_t[::1] stamps
        cdef double[:, ::1] transforms
        cdef const Incoming* incoming
        cdef size_t i, at
        if not batch_read_cdr(&self._batch, <const unsigned char*>PyBytes_AS_STRING(data),
                              PyBytes_GET_SIZE(data)):
            if self._batch.problem != NULL:
                raise batch_error(&self._batch, PyBytes_GET_SIZE(data))
            if self._batch.no_memory:
                raise MemoryError
        self._reserve(self._batch.count)
        children, parents, stamps, transforms = self._arrays
        for i in range(self._batch.count):
            incoming = &self._batch.entries[i].incoming
            at = self._count
            children[at] = self._id(incoming.child, incoming.child_size)
            parents[at] = self._id(incoming.parent, incoming.parent_size)
            stamps[at] = incoming.stamp_ns
            memcpy(&transforms[at, 0], &incoming.transform, sizeof(Transform))
            self._count += 1

    def arrays(self):
        """
        What was read: the arrays that :func:`serialize_samples` takes.

        :return: ``(children, parents, stamps, transforms)``.
        """
        return tuple(array[:self._count] for array in self._arrays)

    cdef uint32_t _id(self, const char* name, size_t size) except? 0:
        cdef uint32_t found = names_find(&self._names, name, size)
        if found == NAME_UNKNOWN:
            raise ValueError(f"a frame that is not among the names: {printable(name[:size].decode())}")
        return found

    cdef int _reserve(self, size_t count) except -1:
        # By half: as a history grows.
        cdef size_t capacity = len(self._arrays[0])
        if self._count + count > capacity:
            grown = _new_arrays(max(self._count + count, capacity + capacity // 2))
            for old, new in zip(self._arrays, grown):
                new[:self._count] = old[:self._count]
            self._arrays = grown
        return 0


cdef tuple _new_arrays(size_t count):
    return (
        new_array((count,), "uint32"),
        new_array((count,), "uint32"),
        new_array((count,), "int64"),
        new_array((count, TRANSFORM_DOUBLES), "float64"),
    )
