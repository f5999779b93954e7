"""
BufferCore, for other extension modules of this project, and what it is built on: the engine behind its lock,
and the conversion of Python objects.

One extension, composed of chapters like ``_core.pxd``.
"""

cimport cython
from cpython.object cimport PyObject
from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t, uint64_t

from tf2_py._core cimport *

include "engine/arrays.pxd"
include "engine/messages.pxd"
include "engine/times.pxd"
include "engine/queries.pxd"
include "engine/state.pxd"
include "engine/engine.pxd"
include "engine/wait.pxd"


@cython.no_gc_clear
cdef class BufferCore(Engine):
    cdef int _set_one(self, object transform, object authority, bint is_static) except -1
    cdef int _lookup_or_raise(self, const Query* query, Transform* out, int64_t* stamp_ns) except -1
    cdef int _transform_at(self, target_frame, source_frame, int64_t time_ns, Transform* out) except -1
    cdef int _lookup_series(self, Query* query, const TimeSeries* series, Py_ssize_t per_time=*) except -1
    cdef int64_t _common_time(self, target_frame, source_frame) except? -1
    cdef int _require_frame(self, frame, str call) except -1
    cdef tuple _can(self, const Query* query)
