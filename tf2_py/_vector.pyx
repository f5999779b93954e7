"""Owns lookups at many times: the path is resolved once, the times go through it in blocks."""

from libc.math cimport NAN
from libc.stdint cimport int64_t, uint32_t
from libc.string cimport memset

from tf2_py._block cimport (
    BLOCK,
    Work,
    block_apply,
    block_begin_source,
    block_begin_source_identity,
    block_begin_target,
    block_carry,
    block_climb_source,
    block_climb_target,
    block_hop,
    block_identity,
    block_put,
    block_result,
    block_store,
)
from tf2_py._cache cimport NEWEST_HINT
from tf2_py._lock cimport Lock, lock_read, unlock
from tf2_py._query cimport Query, query_ends, query_fixed, query_is_identity, query_walk
from tf2_py._tree cimport Tree
from tf2_py._types cimport MAX_HOPS, NO_FRAME, STATUS_OK, FrameId, Status, Transform
from tf2_py._walk cimport LATEST, Path, walk_climb, walk_lookup, walk_path_common_time

cdef enum:
    SLICE = 4 * BLOCK       # times under one lock: an insert waits some tens of microseconds at the most


cdef struct Plan:
    # How the times of one slice are answered.
    bint by_blocks          # one path serves all times; otherwise each time is looked up on its own
    Path path
    uint32_t hints[2 * MAX_HOPS]    # by hop, where the last time was found: source side first
    int64_t common_ns       # what time 0 stands for
    bint has_outer          # a two-time lookup: `outer` carries from the fixed frame to the target
    Transform outer


cdef void _make_plan(const Tree* tree, const Query* query, Plan* plan) noexcept nogil:
    # Whatever may fail or differ from time to time is left to single lookups.
    cdef FrameId target, source, fixed
    cdef Path path
    cdef int64_t stamp_ns
    cdef bint mixed = False
    plan.by_blocks = False
    plan.has_outer = query.fixed != NULL
    plan.path.source_hops = plan.path.target_hops = 0
    if query_is_identity(query):
        plan.by_blocks = True
        return
    if tree.ever_looped or query_ends(tree, query, &target, &source).code != STATUS_OK:
        return
    if plan.has_outer:
        fixed = query_fixed(tree, query)
        if fixed == NO_FRAME:
            return
        if walk_lookup(tree, target, fixed, query.target_ns, &path, &plan.outer, &stamp_ns).code != STATUS_OK:
            return
        target = fixed
    if target != source and not walk_climb(tree, target, source, LATEST, &plan.path, &mixed):
        return
    plan.common_ns = walk_path_common_time(tree, &plan.path)
    plan.by_blocks = not mixed


cdef void _answer_block(const Tree* tree, Plan* plan, const int64_t* asked_ns, uint32_t count,
                        Work* work) noexcept nogil:
    cdef const Path* path = &plan.path
    cdef int64_t times_ns[BLOCK]
    cdef uint32_t i
    memset(work.missing, 0, BLOCK)
    for i in range(count):
        times_ns[i] = asked_ns[i] if asked_ns[i] else plan.common_ns
    if path.source_hops == 0 and path.target_hops == 0:
        block_identity(work)
    else:
        for i in range(path.target_hops):
            block_hop(work, &tree.caches[path.target[i]], times_ns, count, &plan.hints[path.source_hops + i])
            if i == 0:
                block_begin_target(work)
            else:
                block_climb_target(work)
        for i in range(path.source_hops):
            block_hop(work, &tree.caches[path.source[i]], times_ns, count, &plan.hints[i])
            if i == 0:
                block_begin_source(work)
            else:
                block_climb_source(work)
        if path.source_hops == 0:
            block_begin_source_identity(work)
        block_result(work, path.target_hops > 0)
    if plan.has_outer:
        block_apply(work, &plan.outer)


cdef uint32_t _answer_singly(const Tree* tree, const Query* query, const Vector* vector, Py_ssize_t start,
                             uint32_t count, bint all_of_them, Work* work, Status* status) noexcept nogil:
    # The times that a block did not answer. How many are answered, see vector_lookup.
    cdef Query single = query[0]
    cdef Transform transform
    cdef int64_t stamp_ns
    cdef uint32_t i
    cdef int k
    for i in range(count):
        if not (all_of_them or work.missing[i]):
            continue
        single.source_ns = vector.times_ns[start + i]
        status[0] = query_walk(tree, &single, &transform, &stamp_ns)
        if status.code != STATUS_OK:
            if not vector.nan_missing:
                return i
            for k in range(3):
                transform.translation[k] = NAN
            for k in range(4):
                transform.rotation[k] = NAN
        block_put(work, i, &transform)
    return count


cdef Py_ssize_t vector_lookup(const Tree* tree, Lock* lock, const Query* query, const Vector* vector,
                              Status* status) noexcept nogil:
    cdef Work work
    cdef Plan plan
    cdef Py_ssize_t start = 0
    cdef Py_ssize_t slice_end
    cdef uint32_t count, answered, i
    for i in range(2 * MAX_HOPS):
        plan.hints[i] = NEWEST_HINT
    while start < vector.count:
        slice_end = min(start + SLICE, vector.count)
        lock_read(lock)
        _make_plan(tree, query, &plan)
        while start < slice_end:
            count = <uint32_t>min(BLOCK, slice_end - start)
            if plan.by_blocks:
                _answer_block(tree, &plan, vector.times_ns + start, count, &work)
            answered = _answer_singly(tree, query, vector, start, count, not plan.by_blocks, &work, status)
            if vector.points != NULL:
                block_carry(&work, answered, vector.points + 3 * start, vector.carried + 3 * start)
            else:
                block_store(&work, answered, vector.translations + 3 * start, vector.rotations + 4 * start)
            start += answered
            if answered < count:
                unlock(lock)
                return start
        unlock(lock)
    return start
