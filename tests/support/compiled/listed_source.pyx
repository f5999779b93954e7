# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A source of an inbox that needs no middleware: what a test has put into a list."""

from libc.stdint cimport int64_t, uint32_t
from libc.stdlib cimport free, malloc
from libc.string cimport memcpy

from tf2_py._internal cimport load_seq_cst, lock_acquire, lock_release, monotonic_ns, store_seq_cst
from tf2_ros._process.inbox cimport (
    ReceivedMessage,
    InboxSource,
    InboxState,
    inbox_arrived,
    received_reserve,
)

cdef int64_t HELD_NS = 60000000000


cdef struct Listed:
    Listed* following
    ReceivedMessage facts                # its `data` is owned


cdef struct List:
    Listed* first
    uint32_t is_slow            # atomic, as those below: taking one lasts until `goes_on` is set
    uint32_t is_taking
    uint32_t goes_on
    bint gave_up                # nobody has set it


cdef void take_long(List* source) noexcept nogil:
    cdef int64_t until_ns = monotonic_ns() + HELD_NS
    store_seq_cst(&source.is_taking, 1)
    while not load_seq_cst(&source.goes_on) and not source.gave_up:
        source.gave_up = monotonic_ns() > until_ns


cdef bint take_first(List* source, ReceivedMessage* received) noexcept nogil:
    cdef Listed** first = &source.first
    cdef Listed* taken = first[0]
    if taken != NULL and load_seq_cst(&source.is_slow):
        take_long(source)
    if taken == NULL or received_reserve(received, taken.facts.size) == NULL:
        return False
    memcpy(received.data, taken.facts.data, taken.facts.size)
    received.is_static, received.received_ns = False, 0
    first[0] = taken.following
    free(taken.facts.data)
    free(taken)
    return True


cdef class ListedSource(InboxSource):
    cdef List _list
    cdef public object when_silent

    def __cinit__(self):
        self.names = ["the list"]

    cdef bint next(self, ReceivedMessage* received) noexcept nogil:
        return take_first(&self._list, received)

    cdef void detach(self) noexcept:
        self.inbox = NULL
        if self.when_silent is not None:
            self.when_silent(self)

    def slow_down(self):
        """Take for long from now on, as a large message is; until `go_on`."""
        store_seq_cst(&self._list.is_slow, 1)

    def is_taking(self):
        return load_seq_cst(&self._list.is_taking) != 0

    def go_on(self):
        """Return whether somebody still waited for this."""
        store_seq_cst(&self._list.goes_on, 1)
        return not self._list.gave_up

    def put(self, bytes data):
        """Append a message, and tell the inbox."""
        cdef Listed** link = &self._list.first
        cdef Listed* made = <Listed*>malloc(sizeof(Listed))
        made.following, made.facts.size = NULL, len(data)
        made.facts.data = <unsigned char*>malloc(len(data) + 1)
        memcpy(made.facts.data, <const char*>data, len(data))
        if self.inbox == NULL:
            raise RuntimeError("the inbox has ended")
        lock_acquire(&self.inbox.shared.lock)
        while link[0] != NULL:
            link = &link[0].following
        link[0] = made
        lock_release(&self.inbox.shared.lock)
        inbox_arrived(self.inbox, False)
