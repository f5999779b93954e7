"""
Share what arrives with other processes: a ring of messages in a file under /dev/shm.

The file begins with one page that is mapped: the head, written by the owner, says how far the ring reaches;
the board, written by readers, says whether they want messages at once. A description of the owner follows.
Then comes the ring: every message in order, and what the owner's program itself inserts or clears.

A record begins at a position, which only grows; its place in the file is that modulo the capacity. The owner
advances `oldest`, writes, and then publishes `next`. A reader copies a record and then looks at `oldest`
again: if the record lies before it, it may have been overwritten, and the reader continues at `oldest`. Each
static transform is a record of its own. Before the newest one of a child would be overwritten, the owner
writes it again at the end, so the ring always has the newest of each child.

Records are read with `pread`, which returns less where the file is truncated. A reader checks everything it
finds, and any byte may be wrong: at worst, that is a malformed message.
"""

cimport cython
from libc.stddef cimport size_t
from libc.stdint cimport INT64_MAX, int64_t, uint32_t, uint64_t
from libc.stdlib cimport free, malloc, realloc
from libc.string cimport memcpy, memset

from tf2_py._internal cimport (
    NAME_NO_MEMORY,
    Batch,
    Engine,
    ForkedLock,
    Incoming,
    Lock,
    Names,
    batch_write_cdr,
    fork_forget,
    fork_watch,
    incoming_refusals,
    is_utf8,
    lock_acquire,
    lock_free,
    lock_init,
    lock_release,
    monotonic_ns,
    name_strip,
    names_find,
    names_free,
    names_init,
    names_intern,
    word_exchange,
    word_load,
    word_store,
)
from tf2_ros._receive.inbox cimport (
    ROUND_NS,
    Copier,
    Copying,
    Inbox,
    Parcel,
    Source,
    State,
    inbox_remove,
    inbox_has_parcel,
    inbox_insert,
    inbox_read,
    inbox_refuse,
    inbox_serve,
    inbox_wants_all,
    inboxes_lock,
    inboxes_unlock,
    parcel_reserve,
)
from tf2_ros._shared.memory cimport (
    close_file,
    coarse_ns,
    commit_file,
    errno,
    fence,
    futex_wait,
    futex_wake,
    give_back,
    load64,
    map_file,
    read_file,
    store64,
    unmap_file,
    write_file,
)

import errno as errors
import os
import struct
import zlib

# The layout of the file.

cdef enum:
    STEP = 1 << 16              # bytes: the largest page of a supported machine
    BOARD_AT = 2048             # in the page that is mapped
    TEXT_AT = 4096              # of the description: size, checksum, text
    TEXT_BYTES = 4096
    RING_AT = STEP
    UNIT = 64                   # bytes: the length of each record is a multiple
    MOST_RECORD = 2 * STEP      # bytes

    KIND_DYNAMIC = 1            # of records: a message with dynamic transforms
    KIND_STATIC = 2             # a message with one static transform
    KIND_REMOVAL = 3            # all transforms of a frame were removed: its name; without, all dynamic ones
    KIND_PADDING = 4            # fills the end of the file

    LAYOUT = 8                  # changes with any change of the layout

# For how long a reader that has looked wants messages at once.
cdef int64_t WANTED_NS = 1000000000
cdef uint64_t MAGIC = 0x31474e4952324654      # "TF2RING1" on a little-endian machine
cdef uint32_t NO_CHILD = 0xFFFFFFFF


cdef struct Head:
    uint64_t magic
    uint32_t layout
    uint32_t arrivals           # counts records; readers sleep on it
    uint64_t capacity           # bytes of the ring
    uint64_t short_ns           # not 0: for lack of memory, the ring reaches back only this far
    uint64_t missing            # messages for which there was no memory at all
    uint64_t oldest             # position of the oldest record
    uint64_t next               # position behind the newest
    uint64_t cleared            # position behind the newest record of a clear; 0: there was none


cdef struct Board:
    uint64_t wanted_until_ns    # steady time until which a reader wants each message at once
    uint32_t sleeps             # a reader sleeps on `arrivals`


cdef struct Record:
    # Padded to a multiple of UNIT with what follows, so a record of padding fits wherever another one ends.
    uint64_t position           # its own
    uint64_t previous           # where it was written before; `position` unless it was written again
    int64_t written_ns          # steady time
    uint32_t kind
    uint32_t child              # id of a static transform's child; NO_CHILD: never written again
    uint32_t authority_size     # bytes that follow
    uint32_t size               # bytes of the message, which follows the authority


cdef inline uint64_t record_length(const Record* record) noexcept nogil:
    # Bytes, with what follows and padding.
    return (sizeof(Record) + <uint64_t>record.authority_size + record.size + UNIT - 1) // UNIT * UNIT


cdef inline Board* board_of(const Head* head) noexcept nogil:
    return <Board*>(<char*>head + BOARD_AT)


cdef tuple shortage_of(const Head* head):
    # How far back the ring reaches, in nanoseconds, if that is less than its owner wanted, or 0; and how many
    # messages its owner had no memory for.
    return load64(&head.short_ns), load64(&head.missing)


cdef Head* map_head(int descriptor) except NULL:
    cdef void* made = map_file(descriptor)
    if made == NULL:
        raise OSError(errno, os.strerror(errno))
    return <Head*>made


include "parts/writer.pyx"
include "parts/reader.pyx"


def read_text(int descriptor):
    """Read the description of a file's owner; ``b""`` if it cannot be read."""
    for _ in range(TRIES):
        found = os.pread(descriptor, TEXT_BYTES, TEXT_AT)
        if len(found) < 8:
            break
        size, checksum = struct.unpack_from("=II", found)
        text = found[8:8 + size]
        if len(text) == size and zlib.crc32(text) == checksum:
            return text
    return b""
