"""Owns finding out at which times an insert may have changed the parent of a frame."""

from libc.stdint cimport INT64_MAX, INT64_MIN, uint32_t

from tf2_py._core.cache_insert cimport CacheChange
from tf2_py._core.types cimport MIXED_PARENTS, NEWEST


cdef void change_add_parents(Change* change, uint32_t before, uint32_t after, bint limits_common_time,
                             bint ever_looped, const CacheChange* history) noexcept nogil:
    cdef uint32_t count_before
    if not before & MIXED_PARENTS and before != after:
        change_add(change, CHANGE_PARENT, INT64_MIN, INT64_MAX)
        return
    if before & MIXED_PARENTS or ever_looped:
        # A frame with one parent for all times keeps it at times for which it has no data.
        change_add(change, CHANGE_PARENT, history.lost.first, history.lost.last)
    count_before = change.count
    if before & MIXED_PARENTS:
        change_add(change, CHANGE_PARENT, history.relinked.first, history.relinked.last)
        if before != after:
            change_add(change, CHANGE_PARENT, NEWEST, NEWEST)
    # That a history no longer covers a common time matters only where a loop ends, or where one parent for
    # all times is left.
    if change.count > count_before or limits_common_time or before & ~after & MIXED_PARENTS or (
            ever_looped and history.lost.first <= history.lost.last):
        change_add(change, CHANGE_PARENT, ANY_TIME, ANY_TIME)
