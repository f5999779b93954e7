"""
Lookups that wait for an answer, filed under what they lack.

A waiter is one lookup that failed and waits. Its failure shows which changes could help (Lacks): a new name,
data of a frame around a time, anything else about a frame. For each of them the waiter has a watch, in a
sorted set by the name's hash or by frame and time. So an insert finds the waiters that its change can help,
and costs the same however many others there are.

A wake is the work that follows from one change, done in steps by the thread that made the change. First every
waiter that the change can help becomes due. Then the due ones are tried in the order in which they were
added: each is answered, or filed again under what it lacks now. Between two steps the lock may be released.

    waiters_add ──answered──► PLACE_NONE
        └─► PLACE_FILED ──wake──► PLACE_DUE ──answered──► PLACE_NONE: `deliver` has passed the answer on
         (or PLACE_ANY) ◄──failed────┘└─────answered──► PLACE_READY: a thread with the GIL must pass it on

From each place waiters_remove leads to PLACE_NONE. All of this needs the tree's lock.

A forked child forgets the waiters of its parent: the threads that would try, deliver or receive them do not
exist there, and what they point to is not touched again.
"""

cdef struct Watch:
    # A node of a sorted set, embedded by its owner, which must not move it while it is in a set.
    int64_t key             # the set is sorted by it: a time in ns, a hash or an ordinal
    Watch* parent
    Watch* left             # smaller keys, or equal ones
    Watch* right            # larger keys, or equal ones
    uint32_t priority       # random, from the owner; no node has a larger one than its parent
    uint32_t kind           # for the owner's use: a ChangeKind ...
    uint32_t frame          # ... of this frame
    void* owner             # for the owner's use: the Waiter


cdef struct Watches:
    # A sorted set: nodes are found and removed in O(log n). Zero it before its first use.
    Watch* root
    int64_t lowest          # no key is below it; valid if there is a root
    int64_t highest         # no key is above it; valid if there is a root


cdef struct Lack:
    # One change that could help.
    ChangeKind kind
    FrameId frame           # NO_FRAME for CHANGE_NAME
    int64_t key             # a time in ns, 0 for CHANGE_FRAME, or the hash of a name; as in a ChangeItem


cdef struct Lacks:
    # What a failed lookup lacks: without one of these changes it fails again.
    Lack* items             # any one of them may help
    uint32_t count          # items in use
    uint32_t capacity       # items allocated
    bint unknown            # any insert may help: there was no memory, or the lookup ran into a loop


cdef enum Place:
    PLACE_NONE              # not waiting: not yet added, answered and delivered, or removed
    PLACE_FILED             # its watches say which changes can help
    PLACE_ANY               # every insert tries it: its lookup ran into a loop, or there was no memory
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
    bint only_new           # waits for another answer than the one below
    bint answered           # a flag, see sync.pxd: the lookup has an answer ...
    Transform answer        # ... which is this, metres and unit quaternion
    int64_t stamp_ns        # ... at this stamp
    Status hopeless         # a bad code: `answered` is set, but for this reason there will be no answer
    # Called with the lock held, once, when the waiter is answered by a wake. True: the answer is delivered.
    # False: the waiter becomes PLACE_READY.
    bint (*deliver)(Waiter* waiter) noexcept nogil
    void* owner             # for `deliver` and for the owner's code that has the GIL
    void* woken             # for the same


cdef struct FrameWatches:
    Watches data            # for CHANGE_DATA, by time
    Watches frame           # for CHANGE_FRAME


cdef struct Waiters:
    uint32_t count          # waiters in all places but PLACE_READY
    FrameWatches* frames    # by frame
    uint32_t frames_capacity    # frames allocated
    Watches names           # for CHANGE_NAME, by hash
    WaiterList filed        # in PLACE_FILED, in the order of being filed
    WaiterList any          # in PLACE_ANY, in the same order
    WaiterList due          # in PLACE_DUE
    uint64_t arrivals       # waiters ever added
    uint64_t wakes          # wakes ever begun
    uint64_t forgotten      # of the waiters ever added, those before the last fork that made this process ...
    uint64_t forgotten_wakes    # ... and of the wakes
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


# Zero a Waiters before its first use. All of these are called with the tree's lock held.
cdef void waiters_free(Waiters* waiters) noexcept nogil
# Answers the waiter or files it; `answered` is set if it is answered or hopeless. Returns the status of the
# attempt. Zero a Waiter before, then fill query, deliver, owner and woken. It must not move until it is
# removed or answered.
cdef Status waiters_add(Waiters* waiters, const Tree* tree, Waiter* waiter) noexcept nogil
# Returns whether it had no answer yet. No effect on one in PLACE_NONE, or forgotten.
cdef bint waiters_remove(Waiters* waiters, Waiter* waiter) noexcept nogil
cdef void waiter_free(Waiter* waiter) noexcept nogil        # of one that has been removed
# Begins the wake for `wake.change`, which must be filled.
cdef void wake_begin(Waiters* waiters, Wake* wake) noexcept nogil
# Makes one waiter due, or tries one; an answered one that `deliver` has not delivered is appended to `ready`.
# Returns what that cost, in ordinary inserts; 0: nothing is left, the wake is over.
cdef uint32_t wake_step(Waiters* waiters, const Tree* tree, Wake* wake, WaiterList* ready) noexcept nogil
# Removes the first of those in PLACE_READY. `wake`: the last one that appended to the list. NULL: there is
# none.
cdef Waiter* waiters_next_ready(Waiters* waiters, const Wake* wake, WaiterList* ready) noexcept nogil
# In a forked child, before all else: forgets all waiters.
cdef void waiters_forget(Waiters* waiters) noexcept nogil
# NULL, or which invariant does not hold. For example: unless a wake is running, no waiter has an answer.
cdef const char* waiters_check(const Waiters* waiters, const Tree* tree) noexcept nogil
