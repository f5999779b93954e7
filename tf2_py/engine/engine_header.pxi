# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The tree behind its lock, with the waiters for it."""

cdef enum:
    SLICE = 64      # what is done under one lock, in inserts of one transform: some tens of microseconds
    INSERTS_PER_TRY = 2     # the cost of trying a waiter


@cython.no_gc_clear     # threads without the GIL use `_inboxes`
cdef class Engine:
    # Nothing outside this class takes `_lock`, or reads or writes `_tree` and `_waiters`.
    cdef object __weakref__
    cdef Tree _tree                     # with the waiters, read and written under _lock only
    cdef Waiters _waiters
    cdef Lock _lock
    cdef ForkedLock _forked             # _lock
    cdef int64_t _displaced_due_ns      # steady time before which displaced samples are not logged again
    cdef object _throttle               # of log lines ...
    cdef object _refusals               # ... and of those about refused transforms
    cdef uint32_t _malformed            # messages; atomic
    cdef Advice _advice                 # what error texts add
    cdef list _names                    # of the tree, by id, as far as some text has needed them
    cdef list _authorities              # likewise
    cdef object _frozen                 # the FrozenFile that was opened; valid if _tree.equals_file
    cdef ReadHook _inboxes              # the first of those that fill this engine, or None
    cdef uint64_t _removals             # of inboxes
    # Under _lock: no later than what the clock shows. After their first attempt, waits judge ages by it, so
    # that an insert without the GIL may answer too early, but not too late; judge_waiter corrects that.
    cdef ClockReading _clock
    cdef bint _reads_clock              # it was read once
    cdef bint _must_look                # nothing reports that it is set back or begins
    cdef ClockHook _followed_clock      # by which ages are counted; None: there is none

    # The inboxes that fill this engine. A read first inserts what has arrived.
    cdef int add_inbox(self, ReadHook inbox) except -1
    cdef int remove_inbox(self, ReadHook inbox) except -1
    cdef int drain_inboxes(self) except -1
    # In all inboxes, so that what arrives is inserted at once; cleared in one of them, if nothing waits.
    cdef void set_has_waiters(self) noexcept
    cdef void clear_has_waiters(self, uint32_t* has_waiters) noexcept nogil

    # Inserting. `insert_some` inserts a slice of a begun batch and returns whether more is left. Where
    # `batch.needs_report` is set after the last one, `report` is due, with the GIL and while the batch and
    # its names still exist. `insert` does the same with the whole batch; what takes longer than one slice
    # lets other threads run.
    cdef bint insert_some(self, Batch* batch) noexcept nogil
    cdef void finish_wakes(self) noexcept nogil
    cdef void insert(self, Batch* batch)
    # Inserts the whole batch, which is not empty, in place of what its frames have from the first to the last
    # of its stamps, under one lock. Memory is either there for all of it, or nothing changes.
    cdef void replace(self, Batch* batch) noexcept nogil
    # `hand_over` is called with each callable that runs a user's code; None: these are called here.
    cdef int report(self, Batch* batch, object hand_over) except -1
    # Counts a message that could not be read, and returns the ValueError that states why. `size`: its bytes.
    # With a topic, logs the error as well.
    cdef void count_malformed(self) noexcept nogil
    cdef object malformed(self, const Batch* batch, size_t size, str topic=*)
    # Removes every dynamic transform; or, with a name, all of one frame. Returns whether there was any.
    cdef bint remove(self, const char* name, size_t size, object hand_over=*) except -1
    # Resets the engine as if it were new; pending waits go on.
    cdef int start_over(self, const Retention* retention, const Limits* limits) except -1
    # The state for pickles and copies. It names the frozen file from which the buffer was opened; or, if the
    # content or the file has changed since, it contains an image, as write_frozen.
    cdef dict state(self)
    # Writes a frozen file, as write_frozen.
    cdef int write_frozen(self, file) except -1
    # Replace the content, as read_image and read_frozen; pending waits go on. If they raise, nothing has
    # changed.
    cdef int restore(self, image) except -1
    cdef int open_frozen(self, path, expected) except -1

    # Looking up. With `out` NULL, only whether there is an answer.
    cdef Status lookup(self, const Query* query, Transform* out, int64_t* stamp_ns) noexcept nogil
    # As series_lookup.
    cdef Py_ssize_t lookup_series(self, const Query* query, const TimeSeries* series,
                                  Status* status) noexcept nogil
    # As series_knots.
    cdef Py_ssize_t find_knots(self, const Query* query, Knots* knots) noexcept nogil
    # For simple lookups only.
    cdef Status common_time(self, const Query* query, int64_t* common_ns) noexcept nogil
    # As walk_time_range. 0, or -1 without memory.
    cdef int answered_times(self, const Query* query, TimeRange* answered, Status* status) noexcept nogil
    # Fills in the moving frames on the path of the newest samples, up from the source and down to the target,
    # and their ages, or without a clock their newest stamps. There is room for 2 * MAX_HOPS of each; returns
    # how many there are.
    cdef uint32_t moving_frames(self, const Query* query, const ClockReading* clock, FrameId* frames,
                                int64_t* times_ns, Status* status) noexcept nogil
    # The ids of the frames from the source up to the common ancestor and down to the target. Raises what the
    # lookup raises.
    cdef list frames_between(self, target_frame, source_frame, int64_t time_ns)
    # The exception for a status; `call` is the function that the text names.
    cdef object error(self, const Query* query, Status status, str call=*)
    # Logs the time of a query that asks_for_1970 and whose error nobody may see. Waits log theirs themselves.
    cdef int log_1970(self, int64_t time_ns) except -1

    # Its answer and its hops, as an object of new_explanation. Raises what the lookup raises.
    cdef object explanation(self, Query* query)

    # Reads the clock for a query that judges ages, which refers to the reading. `read_clock` raises a
    # ValueError if there is none; `has_read_clock` returns whether there is one.
    cdef int read_clock(self, Query* query, ClockReading* reading) except -1
    cdef bint has_read_clock(self, Query* query, ClockReading* reading) except -1
    # Whether an exception may come from the code of a program's clock; otherwise, what no lookup raises comes
    # from a signal handler.
    cdef bint is_of_clock(self, error) except -1

    # Waiting. The status is that of the first attempt.
    cdef int add_waiter(self, Waiter* waiter, Status* status) except -1
    # Tries one that judges ages again, by what the clock has just shown. Returns whether it has an answer,
    # which then is not delivered otherwise. If not, it waits on. No effect on one removed unanswered.
    cdef bint judge_waiter(self, Waiter* waiter, const ClockReading* reading) except -1
    # Returns whether it was pending. No effect on one that was removed before, or is forgotten.
    cdef bint remove_waiter(self, Waiter* waiter) noexcept nogil
    # Whether it was added before the fork that created this process: then it never gets an answer.
    cdef bint has_forgotten(self, const Waiter* waiter) noexcept nogil
    # Why a lookup fails now; None: it does not.
    cdef object reason(self, const Query* query)

    # Listing, as snapshot_frames, histories_of and learn_names.
    cdef list frame_facts(self, bint roots=*)
    cdef dict frame_histories(self)
    cdef list frame_names(self, frames)
    # Whether the name was ever a parent or child; the reserved one does not count.
    cdef bint has_frame(self, const char* name, size_t size) noexcept nogil
    # Of the newest sample, where the time is 0; NO_FRAME: none, or no data for the time.
    cdef FrameId parent_at(self, const char* name, size_t size, int64_t time_ns) noexcept nogil
    cdef dict counts(self)              # see BufferCore.statistics
    cdef const char* check(self) noexcept nogil     # NULL, or which invariant does not hold

    cdef Status _file_waiter(self, Waiter* waiter) noexcept
    cdef Status _check_names(self, const Query* query) noexcept nogil
    cdef str _limiting_frame(self, const Query* query, Status status)
    cdef tuple _limits_instead(self, const Query* query, Status status)
    cdef int _begin_advice(self) except -1
    cdef int _log_refused(self, Batch* batch) except -1
    cdef int _log_unnormalized(self, Batch* batch) except -1
    cdef void _insert_next(self, Batch* batch, uint32_t authority) noexcept nogil
    cdef void _note_displaced(self, Batch* batch, uint64_t before) noexcept nogil
    # Returns the first of the errors that were raised, or None.
    cdef object _deliver(self, Batch* batch, object hand_over)
    # Takes the tree over, with the frozen file that has it.
    cdef int _replace_tree(self, const Tree* tree, frozen=*) except -1
    cdef void _lock_when_none_is_due(self) noexcept nogil
    cdef void _begin_to_wake_all(self, Batch* batch) noexcept nogil
    cdef int _wake_all(self, Batch* batch, object hand_over=*) except -1


# To be called, with the GIL, before the engine is read for a program.
cdef inline int catch_up(Engine engine) except -1:
    return 0 if engine._inboxes is None else engine.drain_inboxes()
