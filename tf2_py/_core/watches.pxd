"""Sorted sets of what waiters watch: nodes that their owners embed, found and removed in O(log n)."""

from libc.stdint cimport int64_t, uint32_t


cdef struct Watch:
    int64_t key
    Watch* parent
    Watch* left             # smaller keys, or equal ones
    Watch* right            # larger keys, or equal ones
    uint32_t priority       # random, from the owner; no node has a larger one than its parent
    uint32_t kind           # for the owner, with the rest
    uint32_t frame
    void* owner


cdef struct Watches:
    Watch* root
    int64_t lowest          # no key is below it, and none above `highest`; meant where there is a root
    int64_t highest


# Zero a Watches before its first use. Nodes belong to their owners and must stay where they are.
cdef void watches_add(Watches* watches, Watch* watch) noexcept nogil
cdef void watches_remove(Watches* watches, Watch* watch) noexcept nogil
# The first of a range, both ends included; the bounds of the set become those that this has found out.
cdef Watch* watches_between(Watches* watches, int64_t first, int64_t last) noexcept nogil
# The first at or after a key, and the next in order of keys; NULL: there is none.
cdef Watch* watches_from(const Watches* watches, int64_t key) noexcept nogil
cdef Watch* watches_next(const Watch* watch) noexcept nogil
# NULL, or which invariant does not hold.
cdef const char* watches_check(const Watches* watches) noexcept nogil
