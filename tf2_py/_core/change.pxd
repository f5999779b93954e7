"""What an insert has changed, for the lookups that wait."""

from libc.stdint cimport int64_t, uint32_t

from tf2_py._core.cache_insert cimport CacheChange
from tf2_py._core.types cimport NO_FRAME, FrameId


cdef enum ChangeKind:
    CHANGE_NAME             # a name is new
    CHANGE_DATA             # the frame had no samples around these times, and has them now
    CHANGE_PARENT           # the frame may have another parent at these times

cdef enum:
    MAX_CHANGE_ITEMS = 8    # two names, data once, the parent at up to four ranges of times


cdef struct ChangeItem:
    # From first to last, both included: times in ns, or of CHANGE_NAME the hash of the name.
    ChangeKind kind
    int64_t first
    int64_t last


cdef struct Change:
    # A failed lookup whose walk depends on none of this fails again.
    FrameId frame           # the child; NO_FRAME: no history was touched
    FrameId parent          # that the transform names
    bint everything         # any failed lookup may have an answer now
    uint32_t count          # of the items
    ChangeItem items[MAX_CHANGE_ITEMS]

cdef extern from *:
    """
    #include <stdint.h>
    #define TF2_ANY_TIME (INT64_MIN + 1)
    """
    const int64_t ANY_TIME "TF2_ANY_TIME"   # as a time of CHANGE_PARENT: changes with the parent at any time


cdef inline void change_begin(Change* change) noexcept nogil:
    change.count = 0
    change.everything = False
    change.frame = change.parent = NO_FRAME


cdef inline void change_add(Change* change, ChangeKind kind, int64_t first, int64_t last) noexcept nogil:
    # No effect on an empty range.
    cdef ChangeItem* item = &change.items[change.count]
    if first <= last:
        item.kind = kind
        item.first = first
        item.last = last
        change.count += 1


# At which times the frame may have another parent. `before`, `after`, `ever_looped`: as in Tree.
# `limits_common_time`: from now on the frame's newest stamp counts for the latest common time of the paths
# through it, which may become earlier.
cdef void change_add_parents(Change* change, uint32_t before, uint32_t after, bint limits_common_time,
                             bint ever_looped, const CacheChange* history) noexcept nogil
