"""BufferCore for other extension modules of this project."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t

from tf2_py._batch cimport Batch
from tf2_py._lock cimport Lock
from tf2_py._query cimport Query
from tf2_py._tree cimport Tree
from tf2_py._types cimport Status, Transform
from tf2_py._vector cimport Vector


cdef class BufferCore:
    cdef Tree _tree                     # read and written under _lock only
    cdef Lock _lock
    cdef readonly object _throttle      # of log lines
    cdef unsigned long long _malformed  # messages; guarded by the GIL
    # Called without arguments after transforms were taken, or the buffer was cleared, outside the lock.
    cdef public object _on_change

    # Takes what the batch holds under one lock. Afterwards, where `refused` or `no_memory` is set, or somebody wants to
    # know of changes, `report` is due, with the GIL and while the batch and its names are still there.
    cdef void insert(self, Batch* batch) noexcept nogil
    cdef int report(self, Batch* batch) except -1
    # Counts a message that could not be read, and makes the ValueError that says why. `size`: its bytes.
    cdef object malformed(self, const Batch* batch, size_t size)

    cdef int _set_one(self, object transform, object authority, bint is_static) except -1
    # `out` NULL only asks whether there is an answer.
    cdef Status _lookup(self, const Query* query, Transform* out, int64_t* stamp_ns) noexcept nogil
    cdef int _lookup_or_raise(self, const Query* query, Transform* out, int64_t* stamp_ns) except -1
    cdef int _transform_at(self, target_frame, source_frame, int64_t time_ns, Transform* out) except -1
    cdef object _error(self, const Query* query, Status status)
    cdef int _lookup_vector(self, Query* query, const Vector* vector) except -1
    cdef tuple _can(self, const Query* query)
    cdef list _frames_between(self, target_frame, source_frame, int64_t time_ns)
