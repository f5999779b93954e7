"""BufferCore for other extension modules of this project."""

cimport cython
from libc.stdint cimport int64_t

from tf2_py._core.lookup cimport Query
from tf2_py._core.series cimport TimeSeries
from tf2_py._core.types cimport Transform
from tf2_py._engine.sharing cimport SharingEngine


@cython.no_gc_clear
cdef class BufferCore(SharingEngine):
    cdef int _set_one(self, object transform, object authority, bint is_static) except -1
    cdef int _lookup_or_raise(self, const Query* query, Transform* out, int64_t* stamp_ns) except -1
    cdef int _transform_at(self, target_frame, source_frame, int64_t time_ns, Transform* out) except -1
    cdef int _lookup_series(self, Query* query, const TimeSeries* series) except -1
    cdef int64_t _common_time(self, target_frame, source_frame) except? -1
    cdef tuple _can(self, const Query* query)
