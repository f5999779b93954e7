# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Insert transforms that waits need, while one allocation of Python fails, each in turn.

A wait whose transform was inserted has ended, whatever failed; afterwards, waits that are left are canceled.
"""

import _testcapi
import gc

from times_and_transforms import S, transform

from tf2_ros import Buffer

MOST = 40  # more than an insert with two waits allocates


def fails_at(number):
    """Whether the allocation of this number fails in an insert that ends two waits."""
    buffer, called = Buffer(), []
    buffer.set_transform(transform("map", "odom", ns=S), "x")
    subscription = buffer.on_change("map", "base", lambda *_: called.append(1))
    future = buffer.wait_for_transform_async("map", "base", S)
    missing = transform("odom", "base", ns=S)
    # Lists come from those that were freed, if there are any.
    kept = [[] for _ in range(200)]
    error = None
    _testcapi.set_nomemory(number, number + 1)
    try:
        buffer.set_transform(missing, "x")
    except MemoryError as raised:
        error = raised
    finally:
        _testcapi.remove_mem_hooks()
    del kept
    assert future.done() == buffer.can_transform("map", "base", S), (number, error)
    subscription.cancel()
    future.cancel()
    buffer._self_check()
    return error is not None


failed = [fails_at(number) for number in range(MOST)]
gc.collect()
print(sum(failed) > 2, failed[-1])
