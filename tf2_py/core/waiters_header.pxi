# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Lookups that wait for an answer, listed by what they lack.

A waiter is one lookup that failed and waits. It watches one thing at a time, what its last failed attempt
lacked, and is in one of three lists:

- that of frames: it failed for the data of one frame at one time that is not 0;
- that of the shape: a name is unknown, or the frames are not connected;
- that of every insert: it asks for the latest common time, which any frame of its path can move, or under a
  policy, or for another answer than the one that it has; or its path contains, or may contain, a loop.

An insert that changes the shape of the tree (see Change) tries all waiters. Any other one tries those that
watch its frame at a time that has data now, and those of every insert. So after an insert, no waiter is left
whose lookup would succeed. A waiter with `until_refused` is also tried when its time falls behind the horizon
of its frame.

A wake is the work that follows from one change. It first takes the waiters to be tried out of their lists,
so that one that is filed again is not tried again at once. Then they are tried one after the other. Between
two of them the lock may be released, but nothing may change the tree before the last one was tried: as in
tf2, each insert is judged before the next one, which may prune what it has answered. So a thread that wants
to insert first completes the wake of another one.

    waiters_add ──answered──► not listed
        └─► listed ──wake──► due ──answered──► not listed: `woken` is set, a thread blocks until then
              ▲               │ └──answered──► ready: a thread with the GIL must pass it on
              └────failed─────┘

waiters_remove takes a waiter out of any list. All of this needs the tree's lock.

A forked child forgets the waiters of its parent: the threads that would try, deliver or receive them do not
exist there, and what they point to is not touched again.
"""

cdef struct Waiter

cdef struct Link:
    # Of a circular list. One that belongs to no waiter is the list's head, which must not move; a zeroed head
    # is that of an empty list, to which nothing can be added.
    Link* previous
    Link* next
    Waiter* waiter          # NULL: the head


cdef struct Waiter:
    Query query             # its names belong to the waiter's owner
    Link link               # in a list, if `is_listed`
    bint is_listed
    FrameId frame           # it watches this frame ...
    uint32_t entry          # ... by this entry; NO_FRAME: none
    uint64_t arrival        # ordinal among all waiters ever added
    bint only_new           # waits for another answer than this one, and its stamp
    Transform previous
    int64_t previous_ns
    bint until_refused      # ends when the tree refuses the data that its simple lookup at a time lacks
    uint32_t answered       # atomic: the lookup has an answer, or has ended
    # STATUS_OK, or the error that ends the wait: then the two fields below are not set.
    Status status
    Transform answer        # meters and unit quaternion
    int64_t stamp_ns        # of the answer
    Event* woken            # set when a wake has answered it; NULL: the waiter becomes ready instead
    void* owner             # for its code that has the GIL


cdef struct WatchEntry:
    int64_t time_ns
    Waiter* waiter


cdef struct Watched:
    # The waiters that watch one frame.
    WatchEntry* entries
    uint32_t count          # entries in use
    uint32_t capacity       # entries allocated


cdef struct Waiters:
    uint32_t count          # waiters that are listed or due
    Link frames             # those that watch a frame ...
    Watched* watched        # ... by frame
    uint32_t watched_capacity   # frames allocated
    Link shape
    Link every
    uint64_t arrivals       # waiters ever added
    uint64_t forgotten      # those of them before the last fork that made this process
    int64_t in_1970_ns      # the time of the last failed attempt that asks_for_1970; 0: none, or it was taken
    # The wake that is under way.
    Change change           # fill it before wake_begin
    Link due                # the waiters to be tried
    Link* ready             # the list for those with an answer, see wake_begin; NULL: no wake is under way


cdef inline void links_init(Link* head) noexcept nogil:
    head.previous = head.next = head
    head.waiter = NULL


cdef inline bint links_empty(const Link* head) noexcept nogil:
    return head.next == head or head.next == NULL


# Zero a Waiters before.
cdef void waiters_init(Waiters* waiters) noexcept nogil
cdef void waiters_free(Waiters* waiters) noexcept nogil
# Answers the waiter or files it, and returns the status of the attempt. Zero a Waiter before, then fill
# query, woken and owner. It must not move until it is removed or answered.
cdef Status waiters_add(Waiters* waiters, const Tree* tree, Waiter* waiter) noexcept nogil
# Returns whether it had no answer yet. No effect on one that is not listed, or forgotten.
cdef bint waiters_remove(Waiters* waiters, Waiter* waiter) noexcept nogil
# Begins the wake for `waiters.change`, if there is anyone to be tried; none may be under way. Answered
# waiters that no thread blocks for are put into `ready`, in the order of their arrival.
cdef void wake_begin(Waiters* waiters, Link* ready) noexcept nogil
# Tries one waiter of the wake that is under way; the last one ends it.
cdef void wake_step(Waiters* waiters, const Tree* tree) noexcept nogil
# Removes the first of those that are ready. NULL: there is none.
cdef Waiter* waiters_next_ready(Waiters* waiters, Link* ready) noexcept nogil
# In a forked child, before all else: forgets all waiters.
cdef void waiters_forget(Waiters* waiters) noexcept nogil
# NULL, or which invariant does not hold. For example: no listed waiter's lookup would answer.
cdef const char* waiters_check(const Waiters* waiters, const Tree* tree) noexcept nogil
