"""Owns the messages of one reading of the clock: bounded, oldest dropped first."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t
from libc.stdlib cimport free, malloc
from libc.string cimport memcpy

cdef enum:
    MAX_BYTES = 16 << 20        # a paused clock must not fill the memory


cdef void journal_clear(Journal* journal) noexcept nogil:
    while journal.first != NULL:
        _drop_first(journal)


cdef void _drop_first(Journal* journal) noexcept nogil:
    cdef KeptMessage* kept = journal.first
    journal.first = kept.after
    journal.bytes -= kept.size
    if journal.first == NULL:
        journal.last = NULL
    free(kept)


cdef void journal_keep(
    Journal* journal, int64_t now_ns, const unsigned char* data, size_t size
) noexcept nogil:
    cdef KeptMessage* kept
    if now_ns > journal.time_ns:
        journal_clear(journal)
        journal.time_ns = now_ns
    # Without memory a message is not kept: it is in the buffer, and only a jump would ask for it again.
    kept = <KeptMessage*>malloc(sizeof(KeptMessage) + size)
    if kept == NULL:
        return
    kept.after = NULL
    kept.size = size
    memcpy(<unsigned char*>&kept[1], data, size)
    if journal.last != NULL:
        journal.last.after = kept
    else:
        journal.first = kept
    journal.last = kept
    journal.bytes += size
    while journal.bytes > MAX_BYTES and journal.first != journal.last:
        _drop_first(journal)
