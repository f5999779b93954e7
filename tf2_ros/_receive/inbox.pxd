"""Take, parse and insert what has arrived for a buffer, in readers and in threads."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t, uint64_t

from tf2_py._internal cimport Batch, Engine, Lock, ReadHook, Tap

cdef enum:
    ROUND_NS = 100000000        # how long a message waits if nothing asks for it
    # Work is counted in messages of up to WORK_BYTES; a longer one counts as several.
    DRAIN_SLICE = 16            # work until other threads may drain
    READ_SLICE = 64             # work of a read until it releases the GIL
    WORK_BYTES = 2048
    LARGE_BYTES = READ_SLICE * WORK_BYTES   # a longer message is inserted without the lock of all inboxes


cdef struct Parcel:
    # One message. It does not move: waiters refer to its batch.
    Batch batch
    unsigned char* data         # the message; of malloc
    size_t size                 # its bytes
    size_t capacity             # bytes allocated
    size_t topic                # index of its name in `names` of the Source
    Parcel* next


cdef struct Parcels:
    Parcel* first
    Parcel* last
    size_t count


cdef struct Watcher:
    # An executor that is informed of what arrives. Called without the GIL, in any thread.
    void* data                  # for these functions
    void (*arrived)(void* data) noexcept nogil
    # Whether it wants each message at once.
    bint (*is_armed)(void* data) noexcept nogil


cdef struct Copier:
    # Copies what an inbox takes for other processes. Called without the GIL, perhaps by several inboxes.
    void* data                  # for these functions
    void (*copy)(Copier* copier, const Batch* batch) noexcept nogil
    # Whether somebody wants each message at once.
    bint (*is_wanted)(Copier* copier) noexcept nogil


cdef struct State:
    # What is used without the GIL.
    uint32_t pending            # atomic; 0: no message waits
    uint32_t is_full            # atomic: so many messages wait that they must be taken
    uint32_t armed              # atomic: the engine wants each message at once
    uint32_t read               # atomic: rounds for which it wants them because of the last read
    uint32_t wants_each         # atomic: the source must take each message when it arrives
    uint32_t needs_report       # atomic: `reports` may hold something
    Watcher* watcher            # or NULL
    # Guarded by the lock of all inboxes.
    # Takes and inserts messages until it has done this much work, or more. Returns how much. The last one may
    # be large: it is only taken.
    size_t (*take)(State* inbox, size_t most) noexcept nogil
    # Parses the large message in `parcel`. False: it is malformed. NULL: the source takes no large ones.
    bint (*parse)(State* inbox) noexcept nogil
    void* source                # `data` of the Source, for these functions
    void* engine                # NULL: there is none, and nothing is taken
    Parcel* parcel              # for the next message; NULL: not allocated yet
    bint has_large              # `parcel` has a large message, which is to be inserted next
    bint is_inserting           # a thread inserts it: parcel, engine and copier must stay as they are
    Lock inserting              # is held by that thread
    Parcels reports             # messages with something to report
    Copier* copier              # of the buffer, if that is shared; or NULL
    State* next                 # in the list of all that the draining thread serves


# A message waits. `is_full`: so many wait that they must be taken. From any thread, with or without the GIL.
cdef void inbox_arrived(State* inbox, bint is_full) noexcept nogil
# Whether each message is wanted at once.
cdef bint inbox_wants_all(State* inbox) noexcept nogil
# The lock of all inboxes. A thread that holds it takes at most that of an engine, of records or of a ring.
cdef void inboxes_lock() noexcept nogil
cdef void inboxes_unlock() noexcept nogil
# Drains one slice, with the lock held. Returns whether more may be left.
cdef bint inbox_serve(State* inbox) noexcept nogil

# The work of inserting a message of this many bytes.
cdef inline size_t message_work(size_t size) noexcept nogil:
    return 1 + size // WORK_BYTES


# The rest is for the function `take` of a source, with the lock held. This one is called before each message:
# it returns whether there is memory for it, in `parcel`.
cdef bint inbox_has_parcel(State* inbox) noexcept nogil
# Bytes of the parcel's message; NULL: no memory.
cdef unsigned char* parcel_reserve(Parcel* parcel, size_t size) noexcept nogil
# Parses the message of the parcel, and sets a default authority. False: it is malformed. Also for `parse`.
cdef bint inbox_read(State* inbox, size_t topic, bint is_static) noexcept nogil
# Inserts what was parsed, or keeps a malformed message until it is reported.
cdef void inbox_insert(State* inbox, bint is_readable) noexcept nogil
# Removes all dynamic transforms of the engine; or, with a name, all of one frame.
cdef void inbox_remove(State* inbox, const char* name, size_t size) noexcept nogil
# Counts and logs bytes that are not a message; `problem` says why.
cdef void inbox_refuse(State* inbox, size_t topic, const char* problem) noexcept nogil


cdef class Copying(Tap):
    cdef Copier copier


cdef class Watching:
    cdef Watcher watcher        # used until this object is destroyed
    cdef object inboxes         # LiveObjects: those that inform this


cdef class Source:
    # Where the messages of one inbox come from.
    cdef State* inbox           # that inbox, which sets this
    cdef size_t (*take)(State* inbox, size_t most) noexcept nogil      # as in State
    cdef bint (*parse)(State* inbox) noexcept nogil     # as in State
    cdef void* data             # for these functions, which find it as `source`
    cdef bint serves_itself     # it is `asked` at each read, and calls `inbox_serve` in a thread of its own
    cdef list names             # of the topics, for errors
    # All of the following are called with the GIL.
    # A program reads the buffer; returns whether there is anything to take.
    cdef bint asked(self) except -1
    # The messages go into another engine, or none. With the lock held.
    cdef void redirected(self) noexcept
    # The inbox ends: `inbox_arrived` must not be called any more.
    cdef void silence(self) noexcept


cdef class Inbox(ReadHook):
    cdef State _state
    cdef Source _source
    cdef bint _is_closed            # in a forked child, one that was closed before must not take the lock
    cdef object _hand_over
    cdef object _reference          # called, gives the engine or None
    cdef set _used                  # keeps the watchers and copiers that threads without the lock may use
    cdef uint32_t _always           # `pending` of a source that is asked at each read
    cdef uint32_t _was_read         # `read` of such a source, which counts reads itself
    cdef object __weakref__

    cdef void _discharge(self) noexcept
    cdef object _engine(self)
    cdef int _report(self, Engine engine, Parcels* parcels) except -1
