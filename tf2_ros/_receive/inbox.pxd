"""Take, parse and insert what has arrived for a buffer, in readers and in threads."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t, uint64_t

from tf2_py._internal cimport Batch, Engine, Inbox, Lock, Tap

cdef enum:
    ROUND_NS = 100000000        # how long a message waits if nothing asks for it
    SLICE = 16                  # messages that are inserted before other threads may drain


cdef struct Parcel:
    # One message. It does not move: waiters refer to its batch.
    Batch batch
    unsigned char* data         # the message; of malloc
    size_t size                 # its bytes
    size_t capacity             # bytes allocated
    size_t topic                # index of its topic's name
    Parcel* next


cdef struct Parcels:
    Parcel* first
    Parcel* last
    size_t count


ctypedef void (*ExecutorArrived)(void* executor) noexcept nogil
ctypedef bint (*ExecutorIsArmed)(const void* executor) noexcept nogil


cdef struct Copier:
    # Copies what an inbox takes for other processes. Called without the GIL, perhaps by several inboxes.
    void* data                  # for these functions
    # `is_whole`: the batch is the message's; otherwise transforms were dropped from it.
    void (*copy)(Copier* copier, const Parcel* parcel, bint is_whole) noexcept nogil
    # Whether somebody wants each message at once.
    bint (*is_wanted)(Copier* copier) noexcept nogil
    # Called in each round of the thread that drains.
    void (*count_round)(Copier* copier, int64_t now_ns) noexcept nogil


cdef struct State:
    # What is used without the GIL.
    uint32_t pending            # atomic; 0: no message waits
    uint32_t is_full            # atomic: so many messages wait that they must be taken
    uint32_t armed              # atomic: the engine wants each message at once
    uint32_t read               # atomic: rounds for which it wants them because of the last read
    uint32_t wants_each         # atomic: the source must take each message when it arrives
    uint32_t needs_report       # atomic: `reports` may hold something
    # The ExecutorState of a node, the function that informs it, and the one that says whether it wants each
    # message at once; or all NULL. Untyped, because its module needs ROS, and this one does not.
    void* executor
    ExecutorArrived executor_arrived
    ExecutorIsArmed executor_is_armed
    Lock lock                   # guards the rest
    bint is_closed
    # Takes and inserts at most this many messages. Returns how many.
    size_t (*take)(State* inbox, size_t most) noexcept nogil
    void* source                # for it
    void* engine                # NULL: it was destroyed
    Parcel* parcel              # for the next message
    Parcel* spare               # takes its place if the message is kept; NULL: not allocated yet
    Parcels reports             # messages with something to report
    bint is_held                # nothing is taken until `release`
    int64_t until_ns            # dynamic transforms that are stamped later are not inserted
    const char* authority
    size_t authority_size
    Copier* copier              # of the buffer, if that is shared; or NULL
    bint has_arrived            # something, since the draining thread looked last
    State* after                # in the list of all that the draining thread serves


# A message waits. `is_full`: so many wait that they must be taken. From any thread, with or without the GIL.
cdef void inbox_arrived(State* inbox, bint is_full) noexcept nogil
# Whether each message is wanted at once.
cdef bint inbox_wants_all(State* inbox) noexcept nogil
# Drains one slice; `is_behind` becomes True if more is left. Returns whether messages have arrived since the
# last time.
cdef bint inbox_serve(State* inbox, bint* is_behind) noexcept nogil
cdef void inbox_count_round(State* inbox, int64_t now_ns) noexcept nogil
# Has `report_pending` called, by the thread for it.
cdef void inbox_needs_report(State* inbox) noexcept nogil

# The rest is for the function `take` of a source, with the lock held. This one is called first: it returns
# whether there is memory for one more message, which goes into `parcel`.
cdef bint inbox_has_parcel(State* inbox) noexcept nogil
# Bytes of the parcel's message; NULL: no memory.
cdef unsigned char* parcel_reserve(Parcel* parcel, size_t size) noexcept nogil
# Parses the message of the parcel; its authority is the inbox's. False: it is malformed.
cdef bint inbox_read(State* inbox, size_t topic, bint is_static) noexcept nogil
# Inserts what was parsed, or keeps a malformed message until it is reported.
cdef void inbox_insert(State* inbox, bint is_readable) noexcept nogil
# Removes all dynamic transforms of the engine; or, with a name, all of one frame.
cdef void inbox_remove(State* inbox, const char* name, size_t size) noexcept nogil
# Counts and logs bytes that are not a message; `problem` says why.
cdef void inbox_refuse(State* inbox, size_t topic, const char* problem) noexcept nogil


cdef class Copying(Tap):
    cdef Copier copier


cdef class MessageInbox(Inbox):
    cdef State _state
    cdef str _authority             # keeps its UTF-8 alive
    cdef object _reference          # called, gives the engine or None
    cdef list _names                # of the topics, by their index
    cdef list _rounds               # keeps the state of executors that are informed, or were
    cdef Copying _copying           # keeps the copier

    cdef object _engine(self)
    cdef int _set_authority(self, str authority) except -1
    # How many messages may have arrived by now.
    cdef int64_t _arrived_by_now(self) noexcept
    # The engine is another one. With the lock held.
    cdef void _engine_changed(self) noexcept
    cdef void _enlist(self) noexcept
    # No thread uses it from here on.
    cdef void _discharge(self) noexcept
    cdef int report(self, Engine engine) except -1
    cdef int _report_parcels(self, Engine engine, Parcels* parcels) except -1
