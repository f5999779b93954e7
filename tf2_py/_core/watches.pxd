"""Sorted sets of what waiters watch: nodes that their owners embed, found and removed in O(log n)."""

from libc.stdint cimport int64_t, uint32_t


cdef struct Watch:
    int64_t key             # the set is sorted by it: a time in ns, a hash or an ordinal
    Watch* parent
    Watch* left             # smaller keys, or equal ones
    Watch* right            # larger keys, or equal ones
    uint32_t priority       # random, from the owner; no node has a larger one than its parent
    uint32_t kind           # for the owner's use: a ChangeKind ...
    uint32_t frame          # ... of this frame
    void* owner             # likewise: the Waiter


cdef struct Watches:
    Watch* root
    int64_t lowest          # no key is below it; valid where there is a root
    int64_t highest         # no key is above it; likewise


# Zero a Watches before its first use. The owners own the nodes, which must not move while they are in a set.
cdef void watches_add(Watches* watches, Watch* watch) noexcept nogil
cdef void watches_remove(Watches* watches, Watch* watch) noexcept nogil
# The first of a range, both ends included; NULL: there is none. May narrow `lowest` and `highest`.
cdef Watch* watches_between(Watches* watches, int64_t first, int64_t last) noexcept nogil
# The first at or after a key, and the next in order of keys; NULL: there is none.
cdef Watch* watches_from(const Watches* watches, int64_t key) noexcept nogil
cdef Watch* watches_next(const Watch* watch) noexcept nogil
# NULL, or which invariant does not hold.
cdef const char* watches_check(const Watches* watches) noexcept nogil
