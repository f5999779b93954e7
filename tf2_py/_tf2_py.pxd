# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
What BufferCore is built on, for other extension modules of this project: the engine behind its lock, and the
conversion of Python objects.

One extension, composed of chapters like ``_core.pxd``. A chapter that only later ones use has no header.
"""

cimport cython
from cpython.object cimport PyObject
from cpython.ref cimport Py_INCREF
from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t, uint64_t

from tf2_py._core cimport *

include "engine/message_layouts_header.pxi"
include "engine/times_header.pxi"
include "engine/read_messages_header.pxi"
include "engine/reused_messages_header.pxi"
include "engine/advice_header.pxi"
include "engine/engine_hooks_header.pxi"
include "engine/queries_and_errors_header.pxi"
include "engine/engine_header.pxi"
include "engine/wait_header.pxi"
