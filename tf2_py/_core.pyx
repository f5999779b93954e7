# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The core, as one extension: histories, the tree, lookups, waiters, serialized messages."""

from cpython.buffer cimport PyBUF_SIMPLE, PyBuffer_Release, PyObject_GetBuffer
from cpython.bytes cimport PyBytes_FromStringAndSize

include "core/forked_locks.pxi"
include "core/names.pxi"
include "core/history.pxi"
include "core/tree.pxi"
include "core/frozen_format.pxi"
include "core/lookup.pxi"
include "core/explained.pxi"
include "core/series.pxi"
include "core/piecewise_linear.pxi"
include "core/waiters.pxi"
include "core/cdr.pxi"
include "core/batch.pxi"
include "core/replacing.pxi"
