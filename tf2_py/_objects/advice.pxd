"""What an error text says beyond the error: which known name was meant, and which topics are silent."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint64_t


cdef class Advice:
    # Of one buffer. Read and written with the GIL held, and with no lock. Lookups that fail are repeated at
    # high rates, so whole texts are remembered.
    cdef object _find_silence       # called with the buffer, gives `_silence`; None: no listener fills it
    cdef tuple _silence             # which topics are silent: of all, of those of dynamic transforms
    cdef int64_t _silence_until_ns  # steady time until which that is repeated
    cdef dict _texts                # errors about unknown names, by call, argument and name
    cdef dict _suggestions          # for an unknown name, and how many names were known then
    cdef size_t _count              # of the known names
    cdef uint64_t _version          # incremented when what is remembered no longer holds
    cdef int64_t _debt_ns           # time spent on comparing names, less the share of the time since
    cdef int64_t _debt_at_ns        # steady time of that

    # From now on, ask this which topics are silent.
    cdef int ask(self, object find_silence) except -1
    # To be called before each of the following: forgets what no longer holds. `count`: of the known names.
    cdef int begin(self, object buffer, size_t count) except -1
    # The text of the error about a name that is not known; `list_names` gives the known ones.
    cdef str unknown(self, str name, str argument, str call, object list_names)
    # A question for the name that may have been meant; "": none is alike. None: this is not known yet,
    # because too much time has been spent on comparing names.
    cdef str suggestion(self, str name, object list_names)
    # The error, and which topics are silent now, of all or of those of dynamic transforms.
    cdef object with_silence(self, object error, object buffer, bint dynamic_only)
    # The buffer was made anew, with other names.
    cdef int forget(self) except -1

    cdef int _look_for_silence(self, object buffer, int64_t now_ns) except -1
    cdef int _forget_texts(self) except -1
    cdef str _state(self)
    cdef bint _may_compare(self, int64_t now_ns)
