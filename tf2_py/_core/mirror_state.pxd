"""What a tree keeps that mirrors another process's; see mirror.pxd."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t, uint64_t

from tf2_py._core.change cimport Change
from tf2_py._core.segment cimport Row, Segment


cdef struct NumberedRow:
    uint32_t frame
    Row row


cdef struct Mirror:
    Segment* segment
    uint64_t sequence           # of the owner, at which the tree was as its is
    uint64_t trees              # Facts of that time
    uint64_t logged
    size_t names_size
    size_t authorities_size
    int64_t own_cache_time_ns   # for the time after leaving
    const char* problem         # NULL: none; why the tree could no longer be followed
    # What has changed, for the waiters of this process; written only while it is collected.
    bint collects
    bint everything             # any failed lookup may have an answer now; the list was too long
    Change* changes
    uint32_t change_count
    uint32_t change_capacity
    # Scratch memory: what was read, until it is known to be valid.
    NumberedRow* rows
    uint32_t rows_capacity
    char* text
    size_t text_capacity
