"""The engine, as one extension: histories, the tree, lookups, waiters, serialised messages."""

from cpython.buffer cimport PyBUF_SIMPLE, PyBuffer_Release, PyObject_GetBuffer
from cpython.bytes cimport PyBytes_FromStringAndSize

include "core/sync.pyx"
include "core/names.pyx"
include "core/history.pyx"
include "core/tree.pyx"
include "core/frozen.pyx"
include "core/lookup.pyx"
include "core/series.pyx"
include "core/waiters.pyx"
include "core/cdr.pyx"
