# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Sets the time of day back and looks a transform up.

Run with `interposed/time_of_day.c` loaded: `sets_system_time_back.py SECONDS HAS_SOURCE MAX_AGE`. It prints
how many samples the buffer has after that.
"""

import ctypes
import sys
import time
from contextlib import suppress

from times_and_transforms import transform

from tf2_ros import Buffer, TransformException

back_s, has_source, max_age = map(float, sys.argv[1:])
buffer = Buffer()
if has_source:
    buffer.add_source("this test")
buffer.set_transform(transform("map", "base", ns=time.time_ns()), "x")
ctypes.c_long.in_dll(ctypes.CDLL(None), "wall_offset_ns").value = -round(back_s * 1e9)
with suppress(TransformException):
    buffer.lookup_transform("map", "base", 0, **({"max_age": max_age} if max_age else {}))
print(buffer.statistics()["samples"])
