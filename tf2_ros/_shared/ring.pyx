"""
Share what arrives with other processes: a ring of messages in a file under /dev/shm.

The file begins with one page that is mapped: the head, written by the owner, says how far the ring reaches.
Its last word is written by readers: until when they want messages at once. A description of the owner follows
(see `files`). Then comes the ring: every transform in order, and what the owner's program removes.

A record begins at a position, which only grows; its place in the file is that modulo the capacity. The last
one before the end of the ring may reach beyond it, and the next one then begins as far behind its beginning.
The owner advances `oldest`, writes, and then publishes `next`. A reader copies a record and then looks at
`oldest` again: if the record lies before it, it may have been overwritten, and the reader continues at
`oldest`. It has lost messages if what it skips is not all older than the cache time (`displaced`). Each
static transform is a record of its own. Before the newest one of a child would be overwritten, the owner
writes it again at the end, so the ring always has the newest of each child.

Records are read with `pread`, which returns less where the file is truncated. Any byte may be wrong, and may
change at any time. So a reader reads each byte once, and checks its copy before it uses it (`_is_inside`): at
worst, what is wrong is a malformed message.
"""

cimport cython
from libc.errno cimport errno
from libc.stddef cimport size_t
from libc.stdint cimport INT64_MAX, int64_t, uint32_t, uint64_t
from libc.stdlib cimport free, malloc, realloc
from libc.string cimport memcpy, memmove, memset
from posix.mman cimport MAP_FAILED, MAP_SHARED, PROT_READ, PROT_WRITE, mmap, munmap
from posix.unistd cimport close, pread, pwrite

from tf2_py._internal cimport (
    NAME_NO_MEMORY,
    Batch,
    Engine,
    ForkedLock,
    Incoming,
    Lock,
    Names,
    Tap,
    add_seq_cst,
    batch_write_cdr,
    fence_seq_cst,
    fork_forget,
    fork_watch,
    incoming_refusals,
    load64_acquire,
    load_seq_cst,
    lock_acquire,
    lock_free,
    lock_init,
    lock_release,
    monotonic_ns,
    names_find,
    names_free,
    names_init,
    names_intern,
    store64_release,
    store_seq_cst,
)
from tf2_ros._receive.inbox cimport (
    PARCEL_DAMAGE,
    PARCEL_MESSAGE,
    PARCEL_REMOVAL,
    ROUND_NS,
    InboxBase,
    Informed,
    InformedLink,
    Parcel,
    Source,
    inbox_is_awaited,
    inbox_wake_executors,
    parcel_reserve,
)
from tf2_ros._shared.futex cimport futex_wait, futex_wake, give_back

import os

# The layout of the file.

cdef enum:
    STEP = 1 << 16              # bytes: the largest page of a supported machine
    MAPPED_BYTES = 4096         # of the beginning, which nobody may truncate
    RING_AT = STEP
    UNIT = 64                   # bytes: the length of each record is a multiple
    MOST_RECORD = 2 * STEP      # bytes
    OTHER_BYTES = RING_AT + MOST_RECORD         # of the file, before the ring and for a record across its end

    KIND_DYNAMIC = 1            # of records: a message with dynamic transforms
    KIND_STATIC = 2             # a message with one static transform
    KIND_REMOVAL = 3            # all transforms of a frame were removed: its name; without, all dynamic ones

    LAYOUT = 11                 # changes with any change of the layout

# For how long a reader that has looked wants messages at once.
cdef int64_t WANTED_NS = 1000000000
cdef uint64_t MAGIC = 0x31474e4952324654      # "TF2RING1" on a little-endian machine
cdef uint32_t NO_CHILD = 0xFFFFFFFF


cdef struct Head:
    uint64_t magic
    uint32_t layout
    uint32_t arrivals           # counts what was shared; readers sleep on it
    uint64_t capacity           # bytes of the ring
    uint64_t oldest             # position of the oldest record
    uint64_t next               # position behind the newest
    uint64_t cleared            # position behind the newest record of a clear; 0: there was none
    # The newest record that was dropped for lack of room before it was as old as the cache time.
    uint64_t displaced          # position behind it; 0: there was none
    uint64_t room_ns            # how old it became
    # Written by readers, so on a cache line of its own.
    uint64_t wanted_until_ns    # steady time until which a reader wants each message at once


cdef struct RingRecord:
    # Padded to a multiple of UNIT with what follows.
    uint64_t position           # its own
    uint64_t previous           # where it was written before; `position` unless it was written again
    int64_t written_ns          # steady time
    uint32_t kind
    uint32_t child              # id of a static transform's child; NO_CHILD: never written again
    uint32_t size               # bytes of the message, which follows
    uint32_t authority_size     # bytes of the authority, which follows that


cdef inline uint64_t record_length(const RingRecord* record) noexcept nogil:
    # Bytes, with what follows and padding.
    return (sizeof(RingRecord) + <uint64_t>record.size + record.authority_size + UNIT - 1) // UNIT * UNIT


cdef inline int64_t place_of(uint64_t position, uint64_t capacity) noexcept nogil:
    # In the file.
    return <int64_t>(RING_AT + position % capacity)


cdef bint read_file(int descriptor, void* to, size_t size, uint64_t start) noexcept nogil:
    # False: the file does not have this many bytes there.
    return pread(descriptor, to, size, <int64_t>start) == <ssize_t>size


cdef Head* map_head(int descriptor) except NULL:
    # By an open file description of its own: a forked child keeps the one that is mapped, but must not keep
    # that of the owner's lock.
    cdef int other = os.open(f"/proc/self/fd/{descriptor}", os.O_RDWR | os.O_CLOEXEC)
    cdef void* made = mmap(NULL, MAPPED_BYTES, PROT_READ | PROT_WRITE, MAP_SHARED, other, 0)
    cdef int number = errno
    close(other)
    if made == MAP_FAILED:
        raise OSError(number, os.strerror(number))
    return <Head*>made


include "ring_writer.pxi"
include "ring_reader.pxi"
