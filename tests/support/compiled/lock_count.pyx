# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How often the lock of an engine was taken."""

from tf2_py._internal cimport Engine


def locks_of(Engine engine):
    return engine._lock.asked
