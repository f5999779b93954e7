"""
The self check of debug builds, which are those compiled with ``-DTF2_SELF_CHECK``: letting go of a lock after
writing checks every invariant of what it guards, and ends the process where one does not hold.
"""

from libc.stdint cimport uint64_t

from tf2_py._core.lock cimport Lock, unlock_write
from tf2_py._core.mirror cimport mirror_is_current
from tf2_py._core.tree cimport Tree, tree_check
from tf2_py._core.waiters cimport Waiters, waiters_check

cdef extern from *:
    """
    #ifdef TF2_SELF_CHECK
    #include <stdio.h>
    #include <stdlib.h>
    #define TF2_SELF_CHECKS 1
    static _Thread_local uint64_t tf2_work_allowed;
    static void tf2_broken(const char *problem) {
        fputs("tf2 self check: ", stderr);
        fputs(problem, stderr);
        fputs("\\n", stderr);
        abort();
    }
    #else
    #define TF2_SELF_CHECKS 0
    #define tf2_work_allowed (*(uint64_t *)0)
    #define tf2_broken(problem) ((void)(problem))
    #endif
    """
    bint SELF_CHECKS "TF2_SELF_CHECKS"
    uint64_t _work_allowed "tf2_work_allowed"       # of this thread
    void _broken "tf2_broken"(const char* problem) nogil

cdef enum:
    # What each operation pays for its check, in frames, samples and the like. A buffer that holds no more is
    # checked after every operation; a larger one as often as that pays for it.
    CHECK_WORK = 2000
    WORK_OF_WAITER = 10     # its lookup is tried


cdef inline bint _is_affordable(const Tree* tree, const Waiters* waiters) noexcept nogil:
    global _work_allowed
    cdef uint64_t work = tree.names.count + tree.authorities.count + tree.samples
    if waiters != NULL:
        work += waiters.frames_capacity + WORK_OF_WAITER * <uint64_t>waiters.count
    _work_allowed += CHECK_WORK
    if work > _work_allowed:
        return False
    _work_allowed = 0
    return True


# `waiters`: NULL where they cannot have been touched.
cdef inline void unlock_written(Lock* lock, const Tree* tree, const Waiters* waiters) noexcept nogil:
    cdef const char* problem
    if SELF_CHECKS and _is_affordable(tree, waiters):
        problem = tree_check(tree)
        if problem == NULL and waiters != NULL:
            problem = waiters_check(waiters, tree)
        # What another process writes meanwhile is nonsense.
        if problem != NULL and (tree.mirror == NULL or mirror_is_current(tree)):
            _broken(problem)
    unlock_write(lock)
