"""Messages that arrived since the clock last moved forward, for the moment after a jump back."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t

cdef struct KeptMessage:
    KeptMessage* after          # the one that arrived next, or NULL
    size_t size                 # bytes of the serialised message, which follow the struct


cdef struct Journal:
    KeptMessage* first          # the oldest
    KeptMessage* last
    size_t bytes                # of all kept messages
    int64_t time_ns             # of the clock, when it last moved forward


cdef inline const unsigned char* kept_data(const KeptMessage* kept) noexcept nogil:
    return <const unsigned char*>&kept[1]


# Zero a Journal before its first use.
cdef void journal_clear(Journal* journal) noexcept nogil
# Forgets what is kept where the clock has moved forward, then keeps the message. A clock that has moved back
# is going to tell its jump callbacks, and they ask for what is kept.
cdef void journal_keep(
    Journal* journal, int64_t now_ns, const unsigned char* data, size_t size
) noexcept nogil
