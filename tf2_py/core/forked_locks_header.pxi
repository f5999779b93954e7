# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Locks that no fork leaves locked in the child. A thread that holds one takes no other of them."""

cdef struct ForkedLock:
    # A lock in the list. It must not move while it is listed.
    Lock* lock
    # NULL, or what is called in a forked child with `owner`, while no other thread exists.
    void (*in_child)(void* owner) noexcept nogil
    void* owner
    ForkedLock* next


# Zeroed before, but for `in_child` and `owner`. From here to `fork_forget`, a fork waits for the lock, so
# that the child finds what it guards consistent.
cdef void fork_watch(ForkedLock* forked, Lock* lock) noexcept nogil
# No effect on one that is not watched.
cdef void fork_forget(ForkedLock* forked) noexcept nogil
