# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Calls as programs write them, which calls.py measures and bench/instruction_counts.py counts."""

# The calls whose answer is available are over static frames, where what surrounds the lookup weighs most.
AVAILABLE = (
    "buffer.lookup_transform(target, source, time)",
    "buffer.lookup_transform(target, source, time, timeout=duration)",
    "buffer.lookup_transform(target, source, time, timeout=1.0)",
    "buffer.lookup_transform(target, source, time, tolerance=0.1)",
    "buffer.lookup_transform_full(target, time, source, time, fixed)",
    "buffer.lookup_transform_full(target, time, source, time, fixed, timeout=duration)",
    "buffer.can_transform(target, source, time)",
    "buffer.can_transform(target, source, time, timeout=duration)",
    "buffer.can_transform_full(target, time, source, time, fixed)",
    "buffer.transform(point, target)",
    "buffer.transform(point, target, timeout=duration)",
    "await buffer.lookup_transform_async(target, source, time)",
)
# Over moving frames; `newer` is later than their newest samples.
MISSING = (
    "buffer.can_transform(target, source, newer)",
    "buffer.can_transform(target, unknown, newer)",
    "buffer.can_transform(target, source, newer, timeout=none)",
    "buffer.can_transform_full(target, newer, source, newer, fixed)",
    "buffer.lookup_transform(target, source, newer)",
)
CALLS = AVAILABLE + MISSING
EMPTY = "pass"  # what is subtracted from each
