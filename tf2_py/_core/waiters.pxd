"""Lookups that have no answer yet, filed under what they lack."""

from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t

from tf2_py._core.forking cimport ForkNote
from tf2_py._core.lacks cimport Lacks
from tf2_py._core.lookup cimport Query
from tf2_py._core.tree cimport Change, Tree
from tf2_py._core.types cimport Status, Transform
from tf2_py._core.watches cimport Watch, Watches

cdef enum Place:
    PLACE_NONE
    PLACE_FILED             # watches what it lacks
    PLACE_ANY               # for want of memory to be filed: every insert tries it
    PLACE_DUE               # what it watches has changed: whose insert did that must try it
    PLACE_READY             # it has an answer; whose insert completed it must deliver it, with the GIL


cdef struct Waiter

cdef struct WaiterList:
    # First come, first served.
    Waiter* first
    Waiter* last


cdef struct Waiter:
    Query query             # its names belong to the waiter
    Place place
    uint64_t arrival        # ordinal among all waiters
    Watch* watches          # in PLACE_FILED; their memory is kept
    uint32_t watch_count
    uint32_t watch_capacity
    uint64_t filed          # Waiters.wakes when it was
    Watch turn              # in PLACE_DUE: by arrival ...
    Watches* turns          # ... in this set
    Waiter* before          # in the list of its place
    Waiter* after
    WaiterList* ready       # in PLACE_READY: the list that it is in ...
    ForkNote whose          # ... of whom; likewise in PLACE_DUE
    bint answered           # and then:
    Transform answer
    int64_t stamp_ns
    # Called with the lock held, once, when the answer is there. True: it has been delivered. False: to
    # PLACE_READY.
    bint (*deliver)(Waiter* waiter) noexcept nogil
    void* owner             # whoever made the waiter; for `deliver` and those with the GIL
    void* woken             # likewise


cdef enum:
    NAME_SETS = 1 << 12
    NAME_COUNTS = 1 << 16   # so many that 10,000 names leave most of them 0
    UNCOUNTED = 255


cdef struct FrameWatches:
    Watches data            # by time: CHANGE_DATA
    Watches parent          # by time: CHANGE_PARENT


cdef struct NameWatches:
    # Of a hash, other bits choose the count than the set.
    uint8_t counts[NAME_COUNTS]     # of watches; from UNCOUNTED on, nobody knows
    Watches sets[NAME_SETS]         # by hash: CHANGE_NAME


cdef struct Waiters:
    uint32_t count          # in all places but PLACE_READY
    FrameWatches* frames    # by frame
    uint32_t frames_capacity
    NameWatches* names      # NULL: nobody has ever watched one
    WaiterList filed
    WaiterList any
    WaiterList due
    uint32_t generation     # of the process in which wakes were last begun
    uint64_t arrivals       # how many have ever been added
    uint64_t wakes          # how many have ever begun
    uint32_t waking         # how many are under way
    uint64_t draws          # of random numbers
    Lacks lacks             # room to work in


cdef struct Wake:
    # What a change does to those who wait, one waiter at a time: the lock may be given away between two.
    Change change
    uint64_t number
    uint32_t changed        # of Change.changed, the one in hand ...
    int64_t reached         # ... and how far
    Watches due             # those to be tried, by arrival


# Zero a Waiters before its first use. All of these are called with the tree's lock held for writing.
cdef void waiters_free(Waiters* waiters) noexcept nogil
# Answers the waiter, or files it; which of them shows in `answered`. Returns the status of the attempt. Zero
# a Waiter before.
cdef Status waiters_add(Waiters* waiters, const Tree* tree, Waiter* waiter) noexcept nogil
cdef void waiters_remove(Waiters* waiters, Waiter* waiter) noexcept nogil
cdef void waiter_free(Waiter* waiter) noexcept nogil        # of one that has been removed
# Takes up `wake.change`, where `count` is not 0.
cdef void wake_begin(Waiters* waiters, Wake* wake) noexcept nogil
# Looks at one waiter that the change can have helped; whom `deliver` leaves is appended to `ready`. Returns
# what that cost, in inserts; 0: there is none, the wake is over.
cdef uint32_t wake_step(Waiters* waiters, const Tree* tree, Wake* wake, WaiterList* ready) noexcept nogil
# NULL, or which invariant does not hold: among them that nobody waits whose lookup would answer, unless a
# wake is under way.
cdef const char* waiters_check(const Waiters* waiters, const Tree* tree) noexcept nogil
