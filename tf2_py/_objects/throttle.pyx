"""Owns how often something is logged, so that a flood of messages is no flood of lines."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint64_t
from posix.time cimport CLOCK_MONOTONIC, clock_gettime, timespec

from tf2_py._core.names cimport name_hash
from tf2_py._wire.batch cimport Batch, Entry

cdef int64_t PERIOD_NS = 1000000000


cdef enum Verdict:
    VERDICT_NEW             # not logged within the last second
    VERDICT_REPEATED        # logged within the last second
    VERDICT_TOO_MUCH        # LINES_PER_SECOND are logged already


cdef int64_t _now_ns() noexcept nogil:
    cdef timespec now
    clock_gettime(CLOCK_MONOTONIC, &now)
    return now.tv_sec * <int64_t>1000000000 + now.tv_nsec


cdef Verdict _judge(Recent* recent, uint64_t key, int64_t now_ns, bint is_full) noexcept nogil:
    cdef int place
    cdef int free = -1
    for place in range(LINES_PER_SECOND):
        if recent.until_ns[place] <= now_ns:
            free = place
        elif recent.keys[place] == key:
            return VERDICT_REPEATED
    if free < 0 or is_full:
        return VERDICT_TOO_MUCH
    recent.keys[free] = key
    recent.until_ns[free] = now_ns + PERIOD_NS
    return VERDICT_NEW


cdef class Throttle:
    """Lets each key pass once a second, and only so many keys."""

    def passes(self, what):
        """Whether a line about ``what``, hashable, is to be logged now."""
        return _judge(&self._others, <uint64_t><Py_ssize_t>hash(what), _now_ns(), False) == VERDICT_NEW

    cdef size_t choose(self, const Batch* batch, size_t* chosen, uint64_t* more) noexcept:
        cdef int64_t now_ns = _now_ns()
        cdef size_t count = 0
        cdef size_t i
        cdef uint64_t key
        cdef const Entry* entry
        cdef Verdict verdict
        for i in range(batch.count):
            entry = &batch.entries[i]
            if entry.refused == 0:
                continue
            # The reasons change the key of a child; the multiplier, 2^64 / golden ratio, spreads them.
            key = name_hash(entry.incoming.child, entry.incoming.child_size)
            key ^= entry.refused * <uint64_t>0x9E3779B97F4A7C15
            verdict = _judge(&self._refused, key, now_ns, count == LINES_PER_MESSAGE)
            if verdict == VERDICT_NEW:
                chosen[count] = i
                count += 1
            elif verdict == VERDICT_TOO_MUCH:
                self._unlogged += 1
        more[0] = 0
        if self._unlogged and self._summary_ns <= now_ns:
            more[0] = self._unlogged
            self._unlogged = 0
            self._summary_ns = now_ns + PERIOD_NS
        return count
