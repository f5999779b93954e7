"""Lookups that have no answer yet, filed under what they lack."""

from libc.stdint cimport int64_t, uint32_t, uint64_t

from tf2_py._query cimport Query
from tf2_py._tree cimport Tree
from tf2_py._types cimport FrameId, Status, Transform

cdef enum Place:
    # Where a waiter is filed, and so what wakes it.
    PLACE_NONE
    PLACE_LATER             # in a frame's heap: a sample at or after `time_ns`
    PLACE_EARLIER           # in a frame's heap: a sample at or before `time_ns`
    PLACE_FRAME             # in a frame's list: any sample
    PLACE_TREE              # a change of the tree: an unknown name, a missing connection
    PLACE_ANY               # every insert: what it lacks moves with the data
    PLACE_READY             # it has an answer; whose insert completed it must deliver it, with the GIL


cdef struct Waiter

cdef struct WaiterList:
    # First come, first served.
    Waiter* first
    Waiter* last


cdef struct Waiter:
    Query query             # its names belong to the waiter
    Place place
    FrameId frame           # of the first three places
    int64_t time_ns         # of the first two
    uint64_t arrival        # ordinal among all waiters: of equal ones the first comes first
    uint32_t position       # in its heap
    Waiter* before          # in its list
    Waiter* after
    bint answered           # and then:
    Transform answer
    int64_t stamp_ns
    WaiterList* ready       # in PLACE_READY: the list that it is in
    # Called with the lock held, once, when the answer is there. True: it has been delivered. False: to
    # PLACE_READY.
    bint (*deliver)(Waiter* waiter) noexcept nogil
    void* owner             # whoever made the waiter; for `deliver` and those with the GIL
    void* woken             # likewise


cdef struct WaiterHeap:
    Waiter** items          # items[0] is the next to wake
    uint32_t count
    uint32_t capacity       # allocated


cdef struct FrameWaiters:
    WaiterHeap later        # smallest time first
    WaiterHeap earlier      # largest time first
    WaiterList any


cdef struct Waiters:
    uint32_t count          # filed anywhere but in PLACE_READY
    FrameWaiters* frames    # by frame
    uint32_t frames_capacity
    WaiterList tree
    WaiterList any
    uint64_t changes        # Tree.changes when the waiters were last looked at
    uint64_t arrivals       # how many have ever been added


# Zero a Waiters before its first use. All of these are called with the tree's lock held for writing.
cdef void waiters_free(Waiters* waiters) noexcept nogil
# Answers the waiter, or files it; which of them shows in `answered`. Returns the status of the attempt.
cdef Status waiters_add(Waiters* waiters, const Tree* tree, Waiter* waiter) noexcept nogil
cdef void waiters_remove(Waiters* waiters, Waiter* waiter) noexcept nogil
# Looks after an insert at those that it can have helped; whom `deliver` leaves is appended to `ready`.
# Not due where `count` is 0.
cdef void waiters_wake(
    Waiters* waiters, const Tree* tree, FrameId changed, WaiterList* ready
) noexcept nogil
# NULL, or which invariant does not hold.
cdef const char* waiters_check(const Waiters* waiters) noexcept nogil
