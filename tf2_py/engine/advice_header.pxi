# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What error texts add: which known name may have been meant, and which topics are silent."""

cdef class Advice:
    # Belongs to one buffer. Read and written with the GIL held, without a lock. Programs repeat failing
    # lookups at high rates, so suggestions are remembered.
    cdef object _find_silence       # called with the buffer, returns `_silence`; None: no listener fills it
    cdef tuple _silence             # which topics are silent: all topics, only those of dynamic transforms
    cdef int64_t _silence_until_ns  # steady time until which `_silence` is reused
    cdef dict _suggestions          # by unknown name, for the names that are known now
    cdef dict _refusals             # by child, a sentence about the last transform that was refused
    cdef size_t _count              # number of known names

    # From now on, call this to find silent topics.
    cdef int describe_silence_with(self, object find_silence) except -1
    # Must be called before each of the following. `count`: the number of known names.
    cdef int begin(self, object buffer, size_t count) except -1
    # The text of the error about an unknown name; `list_names` returns the known ones.
    cdef str extend(self, str text, str name, object list_names)
    # A transform of this frame was refused, which errors say if they do not know the frame.
    cdef int remember_refused(self, str child, uint32_t reasons) except -1
    # A question that suggests similar names; "": none is similar, or there are too many to compare.
    cdef str suggestion(self, str name, object list_names)
    # Adds to the error which topics are silent now: of all topics, or only of those of dynamic transforms.
    cdef object with_silence(self, object error, object buffer, bint dynamic_only)
    # Must be called when the known names have changed, or transforms were removed.
    cdef int forget(self) except -1

    cdef int _look_for_silence(self, object buffer) except -1
    cdef str _state(self)
