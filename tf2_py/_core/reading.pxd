"""
Reading a tree under its lock, also one that another process writes.

    reading_begin(&reading, tree, lock)
    while reading_continue(&reading):
        ...

The body may run several times; what the last one found is valid. It must not leave the loop.
"""

from libc.stdint cimport uint32_t

from tf2_py._core.lock cimport Lock, lock_read, unlock_read
from tf2_py._core.mirror cimport mirror_is_current
from tf2_py._core.tree cimport Tree


cdef struct Reading:
    Tree* tree
    Lock* lock
    uint32_t bodies         # begun
    bint is_writing         # the lock is held for writing


cdef inline void reading_begin(Reading* reading, const Tree* tree, Lock* lock) noexcept nogil:
    reading.tree = <Tree*>tree      # reading one that is followed brings it up to date
    reading.lock = lock
    reading.bodies = 0
    reading.is_writing = False


# The two ends of a body on a tree that is followed, or was.
cdef bint reading_enter(Reading* reading) noexcept nogil
cdef bint reading_repeat(Reading* reading) noexcept nogil


cdef inline bint reading_continue(Reading* reading) noexcept nogil:
    if reading.bodies == 0:
        reading.bodies = 1
        lock_read(reading.lock)
        return reading.tree.mirror == NULL or mirror_is_current(reading.tree) or reading_enter(reading)
    if reading.tree.mirror == NULL and not reading.is_writing:
        unlock_read(reading.lock)
        return False
    return reading_repeat(reading)
