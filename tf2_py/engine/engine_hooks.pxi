"""The bases of what an engine calls."""

cdef class WaiterOwner:
    """What a Waiter belongs to."""

    cdef object deliver(self):
        raise NotImplementedError

    cpdef str lacks(self):
        raise NotImplementedError


cdef class ReadHook:
    """Is called before an engine is read: an inbox, which inserts what has arrived."""

    cdef int drain(self) except -1:
        raise NotImplementedError

    cdef void engine_ended(self) noexcept:
        pass


cdef class Tap:
    """Copies what an engine receives, by its inboxes and by the program itself."""

    cdef void copy(self, const Batch* batch) noexcept nogil:
        pass

    cdef void removed(self, const char* name, size_t size) noexcept:
        pass

    cdef bint is_wanted(self) noexcept nogil:
        return False
