# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Inserts a transform each second, for an hour, although the buffer has soon reached `max_bytes`.

Run with `interposed/time_of_day.c` loaded.
"""

import ctypes

from times_and_transforms import S, transform

from tf2_py import BufferCore

steady_offset_ns = ctypes.c_long.in_dll(ctypes.CDLL(None), "steady_offset_ns")
buffer = BufferCore(3600.0, max_bytes=20_000)
for seconds in range(3600):
    steady_offset_ns.value = seconds * S
    buffer.set_transform(transform("map", "base", seconds), "test")
