"""The tree behind its lock, with the waiters for it."""

cimport cython
from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t

from tf2_py._core.forking cimport ForkedLock
from tf2_py._core.lock cimport Lock
from tf2_py._core.lookup cimport Query
from tf2_py._core.mirror_state cimport Mirror
from tf2_py._core.path cimport Path
from tf2_py._core.publication cimport Publication
from tf2_py._core.segment cimport Segment
from tf2_py._core.series cimport TimeSeries
from tf2_py._core.tree cimport Limits, Tree
from tf2_py._core.types cimport Status, Transform
from tf2_py._core.waiters cimport Waiter, WaiterList, Waiters
from tf2_py._objects.advice cimport Advice
from tf2_py._wire.batch cimport Batch

cdef extern from "Python.h":
    ctypedef struct CPythonSized "PyVarObject":
        Py_ssize_t ob_size


# Of a list, without the GIL.
cdef inline bint is_filled(void* objects) noexcept nogil:
    return (<CPythonSized*>objects).ob_size > 0


cdef enum:
    SLICE = 64      # what is done under one lock, in inserts of one transform: some tens of microseconds


cdef class SharedMemory:
    # What maps a segment; whoever makes one knows the operating system. It outlives its engine.
    cdef Segment segment


cdef class WaiterOwner:
    # The base of what waits with a Waiter. It holds its engine, and removes the waiter before it is
    # destroyed.
    # Called once, with the GIL and without the lock, when the waiter is answered and has left. Returns what
    # would run a user's code, to be called later, or None.
    cdef object deliver(self)
    # One line: what it waits for, and what it lacks at the moment.
    cpdef str lacks(self)


@cython.no_gc_clear     # what frees the tree needs the memory that it may be in
cdef class Engine:
    # Nothing outside this class takes `_lock`, or reads or writes `_tree` and `_waiters`.
    cdef Tree _tree                     # with the waiters, read and written under _lock only
    cdef Waiters _waiters
    cdef Lock _lock
    cdef ForkedLock _forked             # _lock
    cdef readonly object _throttle      # of log lines
    cdef unsigned long long _malformed      # messages; guarded by the GIL
    cdef unsigned long long _waits_refused  # likewise
    cdef Advice _advice                 # what error texts add
    cdef SharedMemory _memory           # of the tree of this engine, or of the one it follows; or None
    cdef Publication* _publication      # of an owner; NULL: this engine is none; under _lock, as the next
    cdef uint32_t _nudges               # of the thread that follows; it sleeps on this where nothing waits
    cdef Mirror* _mirror                # of one that follows, or did; NULL: it never did
    cdef list _observers                # called after every insert; changed with the GIL, counted without

    # Inserting. `insert_some` inserts a slice of a begun batch and returns whether more is left. Where
    # `batch.needs_report` is set after the last one, `report` is due, with the GIL and while the batch and
    # its names still exist. `insert` does the same with the whole batch; what takes longer than one slice
    # lets other threads run.
    cdef bint insert_some(self, Batch* batch) noexcept nogil
    cdef void insert(self, Batch* batch)
    # `later`: a list that receives what would run a user's code, for the caller to hand over; None: it runs
    # at once.
    cdef int report(self, Batch* batch, list later) except -1
    # Counts a message that could not be read, and returns the ValueError that says why. `size`: its bytes.
    # With a topic, logs the error as well.
    cdef object malformed(self, const Batch* batch, size_t size, str topic=*)
    # Removes every dynamic transform.
    cdef int forget(self) except -1
    # As if newly made; pending waits go on.
    cdef int start_over(self, int64_t cache_time_ns, const Limits* limits) except -1
    # All that the buffer holds, as of one moment, and becoming what such a state says; pending waits go on.
    # Nothing has changed where it raises.
    cdef dict export(self)
    cdef int restore(self, dict state) except -1

    # Looking up. `out` NULL only asks whether there is an answer.
    cdef Status lookup(self, const Query* query, Transform* out, int64_t* stamp_ns) noexcept nogil
    # As series_lookup; -1 where the lookup fails whatever the time.
    cdef Py_ssize_t lookup_series(self, const Query* query, const TimeSeries* series,
                                  Status* status) noexcept nogil
    # Both of the simple lookup only; the path is that at `query.source_ns`.
    cdef Status common_time(self, const Query* query, int64_t* common_ns) noexcept nogil
    cdef Status find_path(self, const Query* query, Path* path) noexcept nogil
    # The exception for a status; `call` is what it says was called.
    cdef object error(self, const Query* query, Status status, str call=*)

    # Waiting. The status is that of the first attempt; raises where there are too many waiters.
    cdef int add_waiter(self, Waiter* waiter, Status* status) except -1
    # Returns whether it was pending. Without effect on one that was removed before.
    cdef bint remove_waiter(self, Waiter* waiter) noexcept nogil
    # The owners of at most `most` pending waiters.
    cdef list pending(self, size_t most)
    # What a wait for a lookup lacks now, in words.
    cdef str lack(self, const Query* query)

    # Listing, as snapshot_frames, snapshot_names and snapshot_span.
    cdef list frame_facts(self, bint roots=*)
    cdef list frame_names(self, frames)
    # The id of a name that was ever a parent or child, or of the reserved one; NAME_UNKNOWN: of neither.
    cdef uint32_t find_name(self, const char* name, size_t size) noexcept nogil
    cdef bint span(self, int64_t* oldest_ns, int64_t* newest_ns) noexcept nogil
    cdef dict counts(self)              # see BufferCore.statistics
    cdef const char* check(self) noexcept nogil     # NULL, or which invariant does not hold

    # What changes the tree of an engine that follows another one makes it leave before.
    cdef bint _take_leave(self, bint at_any_cost) noexcept nogil
    cdef void _nudge(self) noexcept nogil
    # Around what an owner changes.
    cdef void _open(self) noexcept nogil
    cdef void _close(self) noexcept nogil

    cdef int _begin_advice(self) except -1
    cdef int _log_refused(self, Batch* batch) except -1
    cdef void _insert_next(self, Batch* batch, uint32_t authority) noexcept nogil
    # Returns the first of the errors that were raised, or None.
    cdef object _deliver(self, WaiterList* ready, list later)
    # Takes the tree over.
    cdef int _replace_tree(self, const Tree* tree, unsigned long long malformed) except -1
    cdef void _begin_to_wake_all(self, Batch* batch) noexcept nogil
    cdef int _wake_all(self, Batch* batch) except -1
