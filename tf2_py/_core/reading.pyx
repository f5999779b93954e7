"""Owns reading a tree that another process writes: catching up with it before, and trying again after."""

from tf2_py._core.lock cimport lock_write, unlock_read
from tf2_py._core.mirror cimport mirror_catch_up, mirror_is_current
from tf2_py._core.segment cimport segment_ask_for_pause
from tf2_py._core.self_check cimport unlock_written
from tf2_py._core.tree cimport Tree

cdef enum:
    LATE_AFTER = 16         # bodies


cdef bint reading_enter(Reading* reading) noexcept nogil:
    # Catching up writes into the tree. The body then runs under the same hold of the lock: no other thread's
    # turn comes between.
    unlock_read(reading.lock)
    lock_write(reading.lock)
    reading.is_writing = True
    if reading.tree.mirror != NULL:
        mirror_catch_up(reading.tree)
    return True


cdef bint reading_repeat(Reading* reading) noexcept nogil:
    cdef Tree* tree = reading.tree
    if tree.mirror == NULL or mirror_is_current(tree):
        if reading.is_writing:
            unlock_written(reading.lock, tree, NULL)
        else:
            unlock_read(reading.lock)
        return False
    reading.bodies += 1
    if reading.bodies > LATE_AFTER:
        segment_ask_for_pause(tree.mirror.segment, (reading.bodies - LATE_AFTER) // LATE_AFTER)
    if not reading.is_writing:
        return reading_enter(reading)
    mirror_catch_up(tree)
    return True
