"""A source of an inbox that needs no middleware: what a test has put into a list."""

from libc.stdint cimport int64_t
from libc.stdlib cimport free, malloc
from libc.string cimport memcpy

from tf2_ros._receive.inbox cimport (
    SENDER_BYTES,
    Parcel,
    ParcelKind,
    Source,
    inbox_arrived,
    inboxes_lock,
    inboxes_unlock,
    parcel_reserve,
)


cdef struct Listed:
    Listed* following
    Parcel facts                # its `data` is owned


cdef bint take_first(void* source, Parcel* parcel) noexcept nogil:
    cdef Listed** first = <Listed**>source
    cdef Listed* taken = first[0]
    if taken == NULL or parcel_reserve(parcel, taken.facts.size) == NULL:
        return False
    memcpy(parcel.data, taken.facts.data, taken.facts.size)
    parcel.authority_size, parcel.has_authority = taken.facts.authority_size, taken.facts.has_authority
    parcel.size = taken.facts.size - taken.facts.authority_size
    parcel.kind, parcel.is_static, parcel.problem = taken.facts.kind, taken.facts.is_static, "it is torn"
    parcel.received_ns = taken.facts.received_ns
    memcpy(parcel.sender, b"0123456789abcdef", SENDER_BYTES)
    first[0] = taken.following
    free(taken.facts.data)
    free(taken)
    return True


cdef class ListedSource(Source):
    cdef Listed* _first

    def __cinit__(self):
        self.names, self.next, self.data = ["the list"], take_first, &self._first

    def put(self, bytes data, int kind=1, bint is_static=False, bytes authority=None, int64_t received_ns=0):
        """Append a parcel, and tell the inbox."""
        cdef Listed** link = &self._first
        cdef Listed* made = <Listed*>malloc(sizeof(Listed))
        cdef bytes content = data + (authority or b"")
        made.following, made.facts.size = NULL, len(content)
        made.facts.authority_size = len(content) - len(data)
        made.facts.has_authority = authority is not None
        made.facts.data = <unsigned char*>malloc(len(content) + 1)
        memcpy(made.facts.data, <const char*>content, len(content))
        made.facts.kind, made.facts.is_static = <ParcelKind>kind, is_static
        made.facts.received_ns = received_ns
        inboxes_lock()
        while link[0] != NULL:
            link = &link[0].following
        link[0] = made
        inboxes_unlock()
        inbox_arrived(self.inbox, False)
