# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A lookup at many times knows the frames of its limits, whatever other threads write."""

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from times_and_transforms import S, transform

from tf2_py import BufferCore


def test_a_limit_knows_its_frame_while_new_frames_appear():
    buffer = BufferCore()
    buffer.set_transform(transform("map", "base", 1), "x")
    done = threading.Event()

    def grow():
        for i in range(200_000):
            if done.is_set():
                return
            buffer.set_transform(transform("map", f"new_{i}", 1), "x")

    with ThreadPoolExecutor() as threads:
        growing = threads.submit(grow)
        try:
            for _ in range(100):
                # Without its limit, a time after the only sample has no answer.
                buffer.lookup_transforms("map", "base", np.full(5000, 2 * S), tolerance={"base": 1.0})
        finally:
            done.set()
        growing.result()
