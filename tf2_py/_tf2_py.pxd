"""
What BufferCore is built on, for other extension modules of this project: the engine behind its lock, and the
conversion of Python objects.

One extension, composed of chapters like ``_core.pxd``.
"""

cimport cython
from cpython.object cimport PyObject
from cpython.ref cimport Py_INCREF
from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t, uint64_t

from tf2_py._core cimport *

include "engine/arrays.pxd"
include "engine/messages.pxd"
include "engine/times.pxd"
include "engine/queries.pxd"
include "engine/state.pxd"
include "engine/frozen.pxd"
include "engine/engine.pxd"
include "engine/wait.pxd"
