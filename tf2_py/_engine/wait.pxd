"""The wait for one lookup."""

cimport cython

from tf2_py._core.event cimport Event
from tf2_py._core.lookup cimport Query
from tf2_py._core.waiters cimport Waiter
from tf2_py._engine.engine cimport Engine, WaiterOwner


@cython.final
@cython.no_gc_clear
cdef class Wait(WaiterOwner):
    # Waits for one lookup, from its making until it is answered, cancelled or dropped. The collector must not
    # clear it: `_engine` is needed to remove the waiter.
    cdef Waiter _waiter                 # under the engine's lock
    cdef Engine _engine
    cdef tuple _names                   # keeps the query's UTF-8 alive
    cdef object _notify                 # called with the answer, or None: a thread blocks
    cdef Event _woken                   # set with the answer, where a thread blocks

    # Once, on a new one. `names`: target, source and fixed frame. Raises where the buffer has too many
    # waiters, or where a name can never be looked up.
    cdef int begin(self, Engine engine, tuple names, const Query* query, object notify) except -1
