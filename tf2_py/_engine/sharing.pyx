"""Owns sharing a tree between processes: who writes, who follows, and telling waiters of what was written."""

cimport cython
from libc.stdint cimport int64_t, uint32_t, uint64_t
from libc.stdlib cimport calloc, free
from libc.string cimport memset

from tf2_py._core.clock cimport monotonic_ns
from tf2_py._core.flag cimport flag_is_set, flag_set
from tf2_py._core.lock cimport lock_read, lock_write, unlock_read
from tf2_py._core.mirror cimport mirror_begin, mirror_catch_up, mirror_free, segment_problem
from tf2_py._core.mirror_state cimport Mirror
from tf2_py._core.publication cimport Publication, publication_begin, publication_free
from tf2_py._core.segment cimport (
    Segment,
    fence_full,
    load32,
    load64,
    segment_head,
    segment_word,
    store32,
)
from tf2_py._core.self_check cimport unlock_written
from tf2_py._core.types cimport FrameId
from tf2_py._core.waiters cimport wake_begin
from tf2_py._engine.engine cimport Engine, SharedMemory, is_filled
from tf2_py._wire.batch cimport Batch

# After a change that mattered to nobody, so long until the next one is looked at: so a busy owner does not
# keep every process busy.
cdef int64_t NAP_NS = 150000
# How often to look whether the other process lives.
cdef int64_t LOOK_NS = 700 * <int64_t>1000000


cdef void _become_reader(void* owner) noexcept nogil:
    # In a forked child of an owner, which still writes: as of the fork, the tree is a mirror of it.
    (<SharingEngine>owner)._after_fork()


@cython.no_gc_clear
cdef class SharingEngine(Engine):
    """An engine whose tree other processes may read, or that holds what another process's does."""

    def __cinit__(self, *args, **kwargs):
        self._forked.in_child = _become_reader

    cdef void _after_fork(self) noexcept nogil:
        cdef Publication* publication = self._publication
        cdef Mirror* mirror = self._mirror
        cdef FrameId frame
        if publication == NULL:
            return
        self._publication = NULL
        mirror_begin(&self._tree, mirror, publication.segment)
        mirror.sequence = publication.sequence
        mirror.trees = publication.facts.trees
        mirror.logged = publication.facts.logged
        mirror.names_size = publication.facts.names_size
        mirror.authorities_size = publication.facts.authorities_size
        mirror.collects = True
        self._followed = publication.sequence
        self._tree.arena = NULL
        for frame in range(self._tree.names.count):
            self._tree.caches[frame].ring = NULL
            self._tree.caches[frame].arena = NULL

    def _share(self, SharedMemory memory not None):
        """
        Let other processes read the buffer.

        :param memory: new memory, which nobody else writes.
        :raises MemoryError: there is not enough for what the buffer holds.
        :raises ValueError: the buffer has shared memory already.
        """
        cdef Publication* publication
        cdef Mirror* mirror
        cdef bint is_shared = False
        if self._memory is not None:
            raise ValueError("the buffer has shared memory already")
        publication = <Publication*>calloc(1, sizeof(Publication))
        mirror = <Mirror*>calloc(1, sizeof(Mirror))
        if publication != NULL and mirror != NULL:
            lock_write(&self._lock)
            is_shared = publication_begin(publication, &self._tree, &memory.segment) == 0
            if is_shared:
                # The mirror is for forked children.
                self._publication, self._mirror, self._memory = publication, mirror, memory
            unlock_written(&self._lock, &self._tree, &self._waiters)
        if not is_shared:
            if publication != NULL:
                publication_free(publication)
            free(publication)
            free(mirror)
            raise MemoryError

    def _attach(self, SharedMemory memory not None):
        """
        Hold what the buffer of another process holds, from now on.

        :param memory: that the other process writes.
        :raises ValueError: it cannot be followed, the text says why; or the buffer holds frames of its own,
            or has shared memory already.
        """
        cdef const char* problem = segment_problem(&memory.segment)
        cdef Mirror* mirror
        if self._memory is not None:
            raise ValueError("the buffer has shared memory already")
        if problem != NULL:
            raise ValueError(problem.decode())
        mirror = <Mirror*>calloc(1, sizeof(Mirror))
        if mirror == NULL:
            raise MemoryError
        lock_write(&self._lock)
        if self._tree.names.count == 1:
            mirror_begin(&self._tree, mirror, &memory.segment)
            mirror.collects = True
            mirror_catch_up(&self._tree)
            problem = mirror.problem
        else:
            problem = "the buffer holds frames of its own"
        if problem == NULL:
            self._memory, self._mirror = memory, mirror
            self._followed = mirror.sequence
        unlock_written(&self._lock, &self._tree, &self._waiters)
        if problem != NULL:
            mirror_free(mirror)
            free(mirror)
            raise ValueError(problem.decode())

    def _leave(self):
        """Copy what the other process's buffer holds, and be an ordinary buffer from now on."""
        with nogil:
            self._take_leave_now()

    @property
    def _is_attached(self):
        """Whether the buffer holds what another process's holds."""
        return bool(self._follows())

    @property
    def _why_left(self):
        """Why the other process's buffer could not be followed any more; None: nothing prevented it."""
        if self._mirror == NULL or self._mirror.problem == NULL:
            return None
        return self._mirror.problem.decode()

    def _when_waiting(self, begin):
        """Call ``begin`` whenever something begins to wait while the buffer is attached."""
        self._begin_following = begin

    @property
    def _new_data_callbacks(self):
        """The list of what is called after every insert, by the thread that runs users' code."""
        if self._begin_following is not None and self._follows():
            self._begin_following()
            self._stir()
        return self._observers

    @property
    def _is_waited_for(self):
        """Whether anything waits for what the other process inserts."""
        return bool(self._is_wanted())

    def _expect(self):
        """
        Have :meth:`_follow` return at the next change.

        :return: False where there was one since it returned last.
        """
        cdef uint64_t followed
        flag_set(&self._is_expected, True)
        lock_write(&self._lock)
        self._nudge()
        followed = self._followed
        unlock_written(&self._lock, &self._tree, &self._waiters)
        return load64(&segment_head(&self._memory.segment).sequence) == followed

    def _stir(self):
        """Have :meth:`_follow` look again what it is to wait for."""
        lock_write(&self._lock)
        self._nudge()
        unlock_written(&self._lock, &self._tree, &self._waiters)

    def _follow(self, double seconds, list later not None):
        """
        Sleep, without the GIL, until the other process has inserted something that somebody waits for.

        To be called again and again, by one thread. It returns at once where the buffer is no longer
        attached, and makes it leave where the other process has ended.

        :param seconds: for how long at most.
        :param later: receives what would run a user's code.
        :return: 0 where nothing was inserted, 2 where an executor, or what is called after every insert,
            waits for what was; otherwise 1.
        """
        cdef Batch batch
        cdef int64_t until_ns = monotonic_ns() + <int64_t>(seconds * 1e9)
        cdef int64_t left_ns
        cdef bint is_changed
        cdef bint was_changed = False
        cdef bint is_awaited = False
        memset(&batch, 0, sizeof(Batch))
        with nogil:
            while True:
                left_ns = max(until_ns - monotonic_ns(), <int64_t>0)
                is_changed = self._next_change(&batch, min(left_ns, LOOK_NS))
                was_changed = was_changed or is_changed
                is_awaited = is_changed and (
                    flag_is_set(&self._is_expected) or is_filled(<void*>self._observers)
                )
                if (is_awaited or flag_is_set(&self._is_interrupted) or batch.ready.first != NULL
                        or left_ns == 0 or not self._follows()):
                    break
                if is_changed:
                    self._memory.segment.sleep(&self._nudges, load32(&self._nudges), NAP_NS)
                elif not self._memory.segment.is_alive(&self._memory.segment):
                    self._take_leave_now()
        flag_set(&self._is_interrupted, False)
        if is_awaited:
            flag_set(&self._is_expected, False)
            later.extend(self._observers)
        error = self._deliver(&batch.ready, later)
        if error is not None:
            raise error
        return 2 if is_awaited else 1 if was_changed else 0

    def _interrupt_following(self):
        """Have :meth:`_follow` return."""
        flag_set(&self._is_interrupted, True)
        if self._memory is not None:
            self._memory.segment.wake(segment_word(&self._memory.segment))
            self._stir()

    cdef void _take_leave_now(self) noexcept nogil:
        lock_write(&self._lock)
        # The other process may have ended: what has no memory is lost.
        self._take_leave(True)
        unlock_written(&self._lock, &self._tree, &self._waiters)

    cdef bint _follows(self) noexcept nogil:
        # Not without the lock: while the tree is made anew, it is no mirror for a moment.
        cdef bint found
        lock_read(&self._lock)
        found = self._tree.mirror != NULL
        unlock_read(&self._lock)
        return found

    cdef bint _is_wanted(self) noexcept nogil:
        cdef uint32_t count
        lock_read(&self._lock)
        count = self._waiters.count
        unlock_read(&self._lock)
        return count > 0 or flag_is_set(&self._is_expected) or is_filled(<void*>self._observers)

    cdef bint _next_change(self, Batch* batch, int64_t ns) noexcept nogil:
        # Sleeps for it, so long at most, and does what follows from it; False: there was none.
        cdef Segment* segment = &self._memory.segment
        cdef const uint64_t* sequence = &segment_head(segment).sequence
        cdef uint32_t nudges = load32(&self._nudges)
        cdef uint64_t followed
        cdef bint at_rest
        lock_read(&self._lock)
        followed = self._followed
        at_rest = self._tree.mirror != NULL and load64(sequence) == followed
        unlock_read(&self._lock)
        if not at_rest:
            pass
        elif self._is_wanted():
            store32(&segment.board.somebody_waits, 1)
            # The owner writes first and asks then, this says so first and looks then: one of them sees it.
            fence_full()
            if load64(sequence) == followed:
                segment.sleep(segment_word(segment), <uint32_t>followed, ns)
        else:
            # Not on the sequence: whoever waits there is woken for all others, too.
            segment.sleep(&self._nudges, nudges, ns)
        lock_write(&self._lock)
        if self._tree.mirror != NULL:
            mirror_catch_up(&self._tree)
        if self._mirror.sequence == self._followed and self._tree.mirror != NULL:
            unlock_written(&self._lock, &self._tree, &self._waiters)
            return False
        self._followed = self._mirror.sequence
        unlock_written(&self._lock, &self._tree, &self._waiters)
        while self._take_change(batch):
            while self.insert_some(batch):
                pass
        return True

    cdef bint _take_change(self, Batch* batch) noexcept nogil:
        # One change of those collected, and the wake for it; False: there is none.
        cdef Mirror* mirror = self._mirror
        cdef bint found = True
        lock_write(&self._lock)
        batch.count = 0
        # Not batch_begin: what is ready stays so until it is delivered.
        batch.done = 0
        if mirror.everything:
            mirror.everything = False
            mirror.change_count = 0
            batch.wake.change.everything = True
            batch.wake.change.count = 0
        elif mirror.change_count:
            mirror.change_count -= 1
            batch.wake.change = mirror.changes[mirror.change_count]
        else:
            found = False
            self._tree.is_untold = False
        if found:
            wake_begin(&self._waiters, &batch.wake)
            batch.waking = True
        unlock_written(&self._lock, &self._tree, &self._waiters)
        return found
