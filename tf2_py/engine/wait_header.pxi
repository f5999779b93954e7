# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The wait for one lookup."""


@cython.final
@cython.no_gc_clear
cdef class Wait(WaiterOwner):
    # Waits for one lookup, from its creation until it is answered, cancelled or dropped; a forked child does
    # not take over the waits of its parent. The collector must not clear it: `_engine` is needed to remove
    # the waiter.
    cdef Waiter _waiter                 # under the engine's lock
    cdef Engine _engine
    # Guarded by the GIL. False: the engine does not refer to the waiter, and nothing files it again.
    cdef bint _is_filed
    cdef tuple _names                   # keeps the query's UTF-8 alive ...
    cdef PolicyObject _policy           # ... and its limits; or None
    cdef object _notify                 # called with the answer, or None: a thread blocks
    cdef Event _woken                   # set with the answer, where a thread blocks

    # To be called before `begin`: wait for another answer than that of a previous wait or, if that has none,
    # than the one that it was to differ from.
    cdef void only_after(self, Wait previous) noexcept
    # Called once, on a new one. `names`: target, source and fixed frame. Raises if a name can never be looked
    # up, or a limit never apply.
    cdef int begin(self, Engine engine, tuple names, const Query* query, PolicyObject policy,
                   object notify) except -1
    cpdef bint cancel(self) noexcept
    cdef bint _judges_age(self) noexcept
    # The answer as a new message, the error that ends the wait, or None: it goes on.
    cdef object _outcome(self)
    cdef object _find_outcome(self)
