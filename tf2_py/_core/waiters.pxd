"""
Lookups that wait for an answer, filed under what they lack.

A waiter is one lookup that failed and waits. Its failure tells which changes could help (lacks.pxd): a new
name, data of a frame around a time, another parent of a frame at a time. For each of them the waiter has a
watch, in a sorted set by the name's hash or by frame and time. So an insert finds the waiters that its change
can help, and costs the same however many others there are.

A wake is the work that follows from one change, done in steps by the thread that made the change. First every
waiter that the change can help becomes due. Then the due ones are tried in the order in which they were
added: each is answered, or filed again under what it lacks now. Between two steps the lock may be released.

    waiters_add ──answered──► PLACE_NONE
        └─► PLACE_FILED ──wake──► PLACE_DUE ──answered──► PLACE_NONE: `deliver` has passed the answer on
         (or PLACE_ANY) ◄──failed────┘└─────answered──► PLACE_READY: a thread with the GIL must pass it on

From each place waiters_remove leads to PLACE_NONE. All of this needs the tree's lock, held for writing.
"""

from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t

from tf2_py._core.change cimport Change
from tf2_py._core.forking cimport ForkThread
from tf2_py._core.lacks cimport Lacks
from tf2_py._core.lookup cimport Query
from tf2_py._core.tree cimport Tree
from tf2_py._core.types cimport Status, Transform
from tf2_py._core.watches cimport Watch, Watches

cdef enum Place:
    PLACE_NONE              # not waiting: not yet added, answered and delivered, or removed
    PLACE_FILED             # its watches say which changes can help
    PLACE_ANY               # there was no memory for watches: every insert tries it
    PLACE_DUE               # a change can help it: the thread whose wake found that must try it
    PLACE_READY             # it has an answer: the thread that completed it must deliver it, with the GIL


cdef struct Waiter

cdef struct WaiterList:
    # In order of being appended.
    Waiter* first
    Waiter* last


cdef struct Waiter:
    Query query             # its names belong to the waiter's owner
    Place place
    uint64_t arrival        # ordinal among all waiters ever added
    Watch* watches          # in PLACE_FILED; the memory is kept for the next time
    uint32_t watch_count
    uint32_t watch_capacity
    uint64_t filed_at_wake  # Waiters.wakes when it was filed
    Watch due_node          # in PLACE_DUE: by arrival ...
    Watches* due_set        # ... in this set, of the wake that made it due
    Waiter* previous        # in the list of its place
    Waiter* next
    WaiterList* ready       # in PLACE_READY: the list that it is in
    ForkThread thread       # in PLACE_DUE and PLACE_READY: the thread that must try or deliver it
    bint answered           # a flag, see flag.pxd: the lookup has an answer ...
    Transform answer        # ... which is this, metres and unit quaternion
    int64_t stamp_ns        # ... at this stamp
    # Called with the lock held, once, when the waiter is answered by a wake. True: the answer is delivered.
    # False: the waiter becomes PLACE_READY.
    bint (*deliver)(Waiter* waiter) noexcept nogil
    void* owner             # for `deliver` and for the owner's code that has the GIL
    void* woken             # likewise


cdef enum:
    NAME_SETS = 1 << 12
    NAME_COUNTS = 1 << 16   # so many that 10,000 names leave most of them 0
    UNCOUNTED = 255


cdef struct FrameWatches:
    Watches data            # for CHANGE_DATA, by time
    Watches parent          # for CHANGE_PARENT, by time


cdef struct NameWatches:
    # The count is chosen by other bits of the hash than the set.
    uint8_t counts[NAME_COUNTS]     # of watches; once UNCOUNTED, a count stays so
    Watches sets[NAME_SETS]         # for CHANGE_NAME, by hash


cdef struct Waiters:
    uint32_t count          # waiters in all places but PLACE_READY
    FrameWatches* frames    # by frame
    uint32_t frames_capacity    # frames allocated
    NameWatches* names      # NULL: no name was ever watched
    WaiterList filed        # in PLACE_FILED, in the order of being filed
    WaiterList any          # in PLACE_ANY, likewise
    WaiterList due          # in PLACE_DUE
    uint32_t generation     # fork_generation() when the last wake began
    uint64_t arrivals       # waiters ever added
    uint64_t wakes          # wakes ever begun
    uint32_t wakes_running  # begun and not over
    uint64_t random_state   # of the priorities of watches
    Lacks lacks             # scratch memory


cdef struct Wake:
    # What follows from one change.
    Change change
    uint64_t number         # Waiters.wakes once it had begun
    uint32_t item           # of Change.items: the current one ...
    int64_t reached         # ... and the key up to which its watches have been read
    Watches due             # the waiters to be tried, by arrival


# Zero a Waiters before its first use. All of these are called with the tree's lock held for writing.
cdef void waiters_free(Waiters* waiters) noexcept nogil
# Answers the waiter or files it; `answered` tells which. Returns the status of the attempt. Zero a Waiter
# before, then fill query, deliver, owner and woken. It must not move until it is removed or answered.
cdef Status waiters_add(Waiters* waiters, const Tree* tree, Waiter* waiter) noexcept nogil
# No effect on one in PLACE_NONE.
cdef void waiters_remove(Waiters* waiters, Waiter* waiter) noexcept nogil
cdef void waiter_free(Waiter* waiter) noexcept nogil        # of one that has been removed
# Begins the wake for `wake.change`, which must be filled.
cdef void wake_begin(Waiters* waiters, Wake* wake) noexcept nogil
# Makes one waiter due, or tries one; an answered one that `deliver` has not delivered is appended to `ready`.
# Returns what that cost, in ordinary inserts; 0: nothing is left, the wake is over.
cdef uint32_t wake_step(Waiters* waiters, const Tree* tree, Wake* wake, WaiterList* ready) noexcept nogil
# NULL, or which invariant does not hold. One of them: unless a wake is running, or is still to begin after
# what another process has inserted, no waiter's lookup answers.
cdef const char* waiters_check(const Waiters* waiters, const Tree* tree) noexcept nogil
