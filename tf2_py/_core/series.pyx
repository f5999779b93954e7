"""Owns lookups at many times: the path is resolved once, the times go through it in batches."""

from libc.math cimport NAN
from libc.stdint cimport int64_t, uint32_t
from libc.stdlib cimport calloc, free, malloc
from libc.string cimport memset

from tf2_py._core.cache cimport NEWEST_HINT, Cache, cache_parent_of
from tf2_py._core.cache_memory cimport cache_pin, cache_unpin
from tf2_py._core.geometry cimport quaternion_canonicalise, transform_compose
from tf2_py._core.lock cimport Lock, lock_read, unlock_read
from tf2_py._core.lookup cimport Query, query_answer, query_end_frames, query_fixed_frame, query_is_identity
from tf2_py._core.path cimport Path, path_common_time
from tf2_py._core.series_work cimport (
    BATCH_TIMES,
    Work,
    work_apply,
    work_begin_source,
    work_begin_source_identity,
    work_begin_target,
    work_carry,
    work_climb_source,
    work_climb_target,
    work_hop,
    work_identity,
    work_put,
    work_result,
    work_store,
)
from tf2_py._core.tree cimport MIXED_PARENTS, NEWEST, Tree
from tf2_py._core.types cimport HALF_SOURCE, NO_FRAME, STATUS_OK, FrameId, Status, Transform
from tf2_py._core.walk cimport walk_climb, walk_lookup

# A call may go on for long, and inserts come meanwhile. So it pins the histories that it will read and gives
# the lock back: however long it takes, or is kept from running, nobody waits for it. All of its answers are
# of one moment.

cdef enum:
    LONG_PATH = 64          # hops; a batch of times through a longer path would not stay in the cache


cdef struct Plan:
    # How the times are answered.
    bint by_batches          # one path serves all times; otherwise each time is looked up on its own
    Path path
    Cache caches[LONG_PATH]         # by hop, pinned: source side first
    uint32_t hints[LONG_PATH]       # where the last time was found
    uint32_t hops
    int64_t common_ns       # what time 0 stands for
    bint in_view            # each time on its own, in `view`; otherwise in the tree, with its lock
    Tree view               # a copy without names of the frames that a walk can meet, their histories pinned
    FrameId* frames         # which these are
    uint32_t frame_count
    char* met               # by frame: 1: is among them
    FrameId target
    FrameId source
    bint has_outer          # a two-time lookup: `outer` carries from the fixed frame to the target
    Transform outer


cdef void _make_plan(const Tree* tree, const Query* query, Plan* plan) noexcept nogil:
    # Lookups that fail whatever the time are left to the tree.
    cdef FrameId fixed
    cdef Path path
    cdef int64_t stamp_ns
    cdef bint mixed = False
    plan.has_outer = query.fixed != NULL
    plan.hops = plan.path.source_hops = plan.path.target_hops = 0
    plan.in_view = False
    plan.by_batches = query_is_identity(query)
    if plan.by_batches or query_end_frames(tree, query, &plan.target, &plan.source).code != STATUS_OK:
        return
    if plan.has_outer:
        fixed = query_fixed_frame(tree, query)
        if fixed == NO_FRAME:
            return
        if walk_lookup(tree, plan.target, fixed, query.target_ns, &path, &plan.outer,
                       &stamp_ns).code != STATUS_OK:
            return
        plan.target = fixed
    if not tree.ever_looped and (
            plan.target == plan.source
            or walk_climb(tree, plan.target, plan.source, NEWEST, &plan.path, &mixed)):
        plan.by_batches = not mixed and plan.path.source_hops + plan.path.target_hops <= LONG_PATH
    if plan.by_batches:
        plan.common_ns = path_common_time(tree, &plan.path)
        _pin_path(tree, plan)
    else:
        plan.in_view = _pin_reachable(tree, plan)


cdef void _pin_path(const Tree* tree, Plan* plan) noexcept nogil:
    cdef uint32_t i
    for i in range(plan.path.source_hops):
        cache_pin(&tree.caches[plan.path.source[i]], &plan.caches[i])
    plan.hops = plan.path.source_hops
    for i in range(plan.path.target_hops):
        cache_pin(&tree.caches[plan.path.target[i]], &plan.caches[plan.hops + i])
    plan.hops += plan.path.target_hops
    for i in range(plan.hops):
        plan.hints[i] = NEWEST_HINT


cdef inline void _meet(Plan* plan, FrameId frame) noexcept nogil:
    if frame != NO_FRAME and not plan.met[frame]:
        plan.met[frame] = 1
        plan.frames[plan.frame_count] = frame
        plan.frame_count += 1


cdef bint _pin_reachable(const Tree* tree, Plan* plan) noexcept nogil:
    # All frames that parents of any time lead to. Memory that is not touched costs nothing. False: no memory.
    cdef size_t frames = tree.names.count
    cdef const Cache* cache
    cdef FrameId frame
    cdef uint32_t next_frame = 0
    cdef uint32_t i
    plan.view = tree[0]
    plan.frame_count = 0
    plan.view.caches = <Cache*>calloc(frames, sizeof(Cache))
    plan.view.parents = <uint32_t*>calloc(frames, sizeof(uint32_t))
    plan.frames = <FrameId*>malloc(frames * sizeof(FrameId))
    plan.met = <char*>calloc(frames, 1)
    if plan.view.caches == NULL or plan.view.parents == NULL or plan.frames == NULL or plan.met == NULL:
        _free_view(plan)
        return False
    _meet(plan, plan.target)
    _meet(plan, plan.source)
    while next_frame < plan.frame_count:
        frame = plan.frames[next_frame]
        next_frame += 1
        cache = &tree.caches[frame]
        cache_pin(cache, &plan.view.caches[frame])
        plan.view.parents[frame] = tree.parents[frame]
        _meet(plan, tree.parents[frame] & ~<uint32_t>MIXED_PARENTS)
        for i in range(cache.count if tree.parents[frame] & MIXED_PARENTS else 0):
            _meet(plan, cache_parent_of(cache, i))
    return True


cdef void _free_view(Plan* plan) noexcept nogil:
    free(plan.view.caches)
    free(plan.view.parents)
    free(plan.frames)
    free(plan.met)


cdef void _end_plan(Plan* plan) noexcept nogil:
    cdef uint32_t i
    for i in range(plan.hops):
        cache_unpin(&plan.caches[i])
    if plan.in_view:
        for i in range(plan.frame_count):
            cache_unpin(&plan.view.caches[plan.frames[i]])
        _free_view(plan)


cdef void _answer_batch(Plan* plan, const int64_t* asked_ns, uint32_t count, Work* work) noexcept nogil:
    cdef const Path* path = &plan.path
    cdef int64_t times_ns[BATCH_TIMES]
    cdef uint32_t i, k
    memset(work.missing, 0, BATCH_TIMES)
    for i in range(count):
        times_ns[i] = asked_ns[i] if asked_ns[i] else plan.common_ns
    if path.source_hops == 0 and path.target_hops == 0:
        work_identity(work)
    else:
        for i in range(path.target_hops):
            k = path.source_hops + i
            work_hop(work, &plan.caches[k], times_ns, count, &plan.hints[k])
            if i == 0:
                work_begin_target(work)
            else:
                work_climb_target(work)
        for i in range(path.source_hops):
            work_hop(work, &plan.caches[i], times_ns, count, &plan.hints[i])
            if i == 0:
                work_begin_source(work)
            else:
                work_climb_source(work)
        if path.source_hops == 0:
            work_begin_source_identity(work)
        work_result(work, path.target_hops > 0)
    if plan.has_outer:
        work_apply(work, &plan.outer)


cdef Status _answer_one(const Tree* tree, Lock* lock, const Query* query, const Plan* plan, int64_t time_ns,
                        Transform* out) noexcept nogil:
    cdef Query single = query[0]
    cdef Path path
    cdef Status status
    cdef int64_t stamp_ns
    if not plan.in_view:
        single.source_ns = time_ns
        lock_read(lock)
        status = query_answer(tree, &single, out, &stamp_ns)
        unlock_read(lock)
        return status
    status = walk_lookup(&plan.view, plan.target, plan.source, time_ns, &path, out, &stamp_ns)
    if plan.has_outer:
        status.half = HALF_SOURCE
        if status.code == STATUS_OK:
            transform_compose(&plan.outer, out, out)
            quaternion_canonicalise(out.rotation)
    return status


cdef uint32_t _answer_singly(const Tree* tree, Lock* lock, const Query* query, const Plan* plan,
                             const TimeSeries* series, Py_ssize_t start, uint32_t count, Work* work,
                             Status* status) noexcept nogil:
    # The times that no batch has answered. How many are answered, see series_lookup.
    cdef Transform transform
    cdef uint32_t i
    cdef int k
    for i in range(count):
        if plan.by_batches and not work.missing[i]:
            continue
        if not (plan.by_batches and series.nan_missing):
            status[0] = _answer_one(tree, lock, query, plan, series.times_ns[start + i], &transform)
            if status.code == STATUS_OK:
                work_put(work, i, &transform)
                continue
            if not series.nan_missing:
                return i
        for k in range(3):
            transform.translation[k] = NAN
        for k in range(4):
            transform.rotation[k] = NAN
        work_put(work, i, &transform)
    return count


cdef Py_ssize_t series_lookup(const Tree* tree, Lock* lock, const Query* query, const TimeSeries* series,
                              Status* status) noexcept nogil:
    cdef Work work
    cdef Plan plan
    cdef Py_ssize_t start = 0
    cdef uint32_t count = 0
    cdef uint32_t answered = 0
    lock_read(lock)
    _make_plan(tree, query, &plan)
    unlock_read(lock)
    while start < series.count and answered == count:
        count = <uint32_t>min(<Py_ssize_t>BATCH_TIMES, series.count - start)
        if plan.by_batches:
            _answer_batch(&plan, series.times_ns + start, count, &work)
        answered = _answer_singly(tree, lock, query, &plan, series, start, count, &work, status)
        if series.points != NULL:
            work_carry(&work, answered, series.points + 3 * start, series.carried + 3 * start)
        else:
            work_store(&work, answered, series.translations + 3 * start, series.rotations + 4 * start)
        start += answered
    _end_plan(&plan)
    return start
