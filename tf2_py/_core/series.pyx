"""Owns lookups at many times: the path is found once, the times are computed along it in batches."""

from libc.math cimport NAN
from libc.stdint cimport SIZE_MAX, int64_t, uint32_t
from libc.stdlib cimport calloc, free, malloc
from libc.string cimport memset

from tf2_py._core.cache cimport NEWEST_HINT, Cache, cache_parent_of
from tf2_py._core.cache_memory cimport CACHE_INSERTED, cache_move, cache_pin, cache_unpin
from tf2_py._core.geometry cimport quaternion_canonicalise, transform_compose
from tf2_py._core.lock cimport Lock
from tf2_py._core.lookup cimport Query, query_answer, query_end_frames, query_fixed_frame, query_is_identity
from tf2_py._core.mirror cimport mirror_holds
from tf2_py._core.mirror_state cimport Mirror
from tf2_py._core.path cimport Path, path_common_time
from tf2_py._core.reading cimport Reading, reading_begin, reading_continue
from tf2_py._core.segment cimport segment_ask_for_pause
from tf2_py._core.series_work cimport (
    BATCH_TIMES,
    SeriesWork,
    work_apply,
    work_begin_source,
    work_begin_source_identity,
    work_begin_target,
    work_climb_source,
    work_climb_target,
    work_hop,
    work_identity,
    work_put,
    work_result,
    work_store,
    work_transform_points,
)
from tf2_py._core.tree cimport Tree
from tf2_py._core.types cimport (
    HALF_SOURCE,
    MIXED_PARENTS,
    NEWEST,
    NO_FRAME,
    STATUS_OK,
    FrameId,
    Status,
    Transform,
    status_of,
)
from tf2_py._core.walk cimport walk_climb, walk_lookup

# A call may take long. So it pins the histories that it reads and releases the lock: however long it takes,
# no insert waits for it, and all of its answers belong to one state of the buffer.

cdef enum:
    # Of another process's histories: how often they are read where they lie, and copied before.
    TRIES_IN_PLACE = 2
    TRIES = 30
    LONG_PATH = 64          # hops; the data of a batch along a longer path would not fit into the cache


cdef struct PinnedLookup:
    # A lookup, and pinned copies of what it reads. There are three ways to answer.
    # By batches: one path serves all times.
    bint by_batches
    Path path
    Cache caches[LONG_PATH]         # by hop, pinned: source side first
    FrameId hop_frames[LONG_PATH]   # by hop
    uint32_t hints[LONG_PATH]       # by hop: where the last time was found
    uint32_t hops
    int64_t common_ns       # the latest common time, which time 0 stands for
    # Otherwise each time on its own, in `view`; and without a view in the tree, with its lock.
    bint has_view
    Tree view               # a copy, without names, of the frames that a walk can reach; histories pinned
    FrameId* frames         # in the view
    uint32_t frame_count
    char* is_added          # by frame; 1: it is in the view
    # For all three.
    FrameId target          # of a two-time lookup: the fixed frame
    FrameId source
    bint has_fixed          # a two-time lookup: to be composed with `fixed_to_target`
    Transform fixed_to_target


cdef void _pin_lookup(const Tree* tree, const Query* query, PinnedLookup* pinned) noexcept nogil:
    # With the lock held. Lookups that fail whatever the time are left to the tree.
    cdef FrameId fixed
    cdef Path path
    cdef int64_t stamp_ns
    cdef bint mixed = False
    pinned.has_fixed = query.fixed != NULL
    pinned.hops = pinned.path.source_hops = pinned.path.target_hops = 0
    pinned.has_view = False
    pinned.by_batches = query_is_identity(query)
    if pinned.by_batches or query_end_frames(tree, query, &pinned.target, &pinned.source).code != STATUS_OK:
        return
    if pinned.has_fixed:
        fixed = query_fixed_frame(tree, query)
        if fixed == NO_FRAME:
            return
        if walk_lookup(tree, pinned.target, fixed, query.target_ns, &path, &pinned.fixed_to_target,
                       &stamp_ns).code != STATUS_OK:
            return
        pinned.target = fixed
    if not tree.ever_looped and (
            pinned.target == pinned.source
            or walk_climb(tree, pinned.target, pinned.source, NEWEST, &pinned.path, &mixed)):
        pinned.by_batches = not mixed and pinned.path.source_hops + pinned.path.target_hops <= LONG_PATH
    if pinned.by_batches:
        pinned.common_ns = path_common_time(tree, &pinned.path)
        _pin_path(tree, pinned)
    else:
        pinned.has_view = _pin_reachable(tree, pinned)


cdef void _pin_path(const Tree* tree, PinnedLookup* pinned) noexcept nogil:
    cdef uint32_t i
    for i in range(pinned.path.source_hops):
        pinned.hop_frames[i] = pinned.path.source[i]
    pinned.hops = pinned.path.source_hops
    for i in range(pinned.path.target_hops):
        pinned.hop_frames[pinned.hops + i] = pinned.path.target[i]
    pinned.hops += pinned.path.target_hops
    for i in range(pinned.hops):
        cache_pin(&tree.caches[pinned.hop_frames[i]], &pinned.caches[i])
        pinned.hints[i] = NEWEST_HINT


cdef inline void _add_frame(PinnedLookup* pinned, FrameId frame) noexcept nogil:
    if frame != NO_FRAME and frame < pinned.view.names.count and not pinned.is_added[frame]:
        pinned.is_added[frame] = 1
        pinned.frames[pinned.frame_count] = frame
        pinned.frame_count += 1


cdef bint _pin_reachable(const Tree* tree, PinnedLookup* pinned) noexcept nogil:
    # All frames that parents of any time lead to. False: no memory. Of the arrays, only the pages that are
    # written cost memory.
    cdef size_t frames = tree.names.count
    cdef const Cache* cache
    cdef FrameId frame
    cdef uint32_t next_frame = 0
    cdef uint32_t i
    pinned.view = tree[0]
    pinned.frame_count = 0
    pinned.view.caches = <Cache*>calloc(frames, sizeof(Cache))
    pinned.view.parents = <uint32_t*>calloc(frames, sizeof(uint32_t))
    pinned.frames = <FrameId*>malloc(frames * sizeof(FrameId))
    pinned.is_added = <char*>calloc(frames, 1)
    if (pinned.view.caches == NULL or pinned.view.parents == NULL or pinned.frames == NULL
            or pinned.is_added == NULL):
        _free_view(pinned)
        return False
    _add_frame(pinned, pinned.target)
    _add_frame(pinned, pinned.source)
    while next_frame < pinned.frame_count:
        frame = pinned.frames[next_frame]
        next_frame += 1
        cache = &tree.caches[frame]
        cache_pin(cache, &pinned.view.caches[frame])
        pinned.view.parents[frame] = tree.parents[frame]
        _add_frame(pinned, tree.parents[frame] & ~<uint32_t>MIXED_PARENTS)
        for i in range(cache.count if tree.parents[frame] & MIXED_PARENTS else 0):
            _add_frame(pinned, cache_parent_of(cache, i))
    return True


cdef void _free_view(PinnedLookup* pinned) noexcept nogil:
    free(pinned.view.caches)
    free(pinned.view.parents)
    free(pinned.frames)
    free(pinned.is_added)


cdef void _unpin_lookup(PinnedLookup* pinned) noexcept nogil:
    cdef uint32_t i
    for i in range(pinned.hops):
        cache_unpin(&pinned.caches[i])
    if pinned.has_view:
        for i in range(pinned.frame_count):
            cache_unpin(&pinned.view.caches[pinned.frames[i]])
        _free_view(pinned)


cdef bint _holds(const Mirror* mirror, const PinnedLookup* pinned) noexcept nogil:
    # Whether nobody has written over what is pinned. NULL: nobody can.
    cdef uint32_t i
    if mirror == NULL:
        return True
    if not mirror_holds(mirror, pinned.hop_frames, pinned.caches, pinned.hops):
        return False
    for i in range(pinned.frame_count if pinned.has_view else 0):
        if not mirror_holds(mirror, &pinned.frames[i], &pinned.view.caches[pinned.frames[i]], 1):
            return False
    return True


cdef inline bint _copy(Cache* cache) noexcept nogil:
    cdef uint32_t disturbed = cache.disturbed
    if cache.capacity and cache_move(cache, cache.capacity, SIZE_MAX // 2) != CACHE_INSERTED:
        return False
    cache.disturbed = disturbed     # by the owner
    return True


cdef bint _copy_pinned(PinnedLookup* pinned) noexcept nogil:
    # The histories of another process. False: no memory, and what was copied is unpinned as the others are.
    cdef uint32_t i
    for i in range(pinned.hops):
        if not _copy(&pinned.caches[i]):
            return False
    for i in range(pinned.frame_count if pinned.has_view else 0):
        if not _copy(&pinned.view.caches[pinned.frames[i]]):
            return False
    return True


cdef void _answer_batch(PinnedLookup* pinned, const int64_t* asked_ns, uint32_t count,
                        SeriesWork* work) noexcept nogil:
    cdef const Path* path = &pinned.path
    cdef int64_t times_ns[BATCH_TIMES]
    cdef uint32_t i, k
    memset(work.missing, 0, BATCH_TIMES)
    for i in range(count):
        times_ns[i] = asked_ns[i] if asked_ns[i] else pinned.common_ns
    if path.source_hops == 0 and path.target_hops == 0:
        work_identity(work)
    else:
        for i in range(path.target_hops):
            k = path.source_hops + i
            work_hop(work, &pinned.caches[k], times_ns, count, &pinned.hints[k])
            if i == 0:
                work_begin_target(work)
            else:
                work_climb_target(work)
        for i in range(path.source_hops):
            work_hop(work, &pinned.caches[i], times_ns, count, &pinned.hints[i])
            if i == 0:
                work_begin_source(work)
            else:
                work_climb_source(work)
        if path.source_hops == 0:
            work_begin_source_identity(work)
        work_result(work, path.target_hops > 0)
    if pinned.has_fixed:
        work_apply(work, &pinned.fixed_to_target)


cdef Status _answer_one(const Tree* tree, Lock* lock, const Query* query, const PinnedLookup* pinned,
                        int64_t time_ns, Transform* out) noexcept nogil:
    cdef Query single = query[0]
    cdef Path path
    cdef Status status = status_of(STATUS_OK)
    cdef int64_t stamp_ns
    cdef Reading reading
    if not pinned.has_view:
        single.source_ns = time_ns
        reading_begin(&reading, tree, lock)
        while reading_continue(&reading):
            status = query_answer(tree, &single, out, &stamp_ns)
        return status
    status = walk_lookup(&pinned.view, pinned.target, pinned.source, time_ns, &path, out, &stamp_ns)
    if pinned.has_fixed:
        status.half = HALF_SOURCE
        if status.code == STATUS_OK:
            transform_compose(&pinned.fixed_to_target, out, out)
            quaternion_canonicalise(out.rotation)
    return status


cdef uint32_t _answer_singly(const Tree* tree, Lock* lock, const Query* query, const PinnedLookup* pinned,
                             const TimeSeries* series, Py_ssize_t start, uint32_t count, SeriesWork* work,
                             Status* status) noexcept nogil:
    # The times that the batch has not answered. Returns how many of `count` are answered, see series_lookup.
    cdef Transform transform
    cdef uint32_t i
    cdef int k
    for i in range(count):
        if pinned.by_batches and not work.missing[i]:
            continue
        if not (pinned.by_batches and series.nan_missing):
            status[0] = _answer_one(tree, lock, query, pinned, series.times_ns[start + i], &transform)
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


cdef Mirror* _pin(const Tree* tree, Lock* lock, const Query* query, PinnedLookup* pinned) noexcept nogil:
    # Of a tree that mirrors another process's, the mirror: the histories are pinned by nobody.
    cdef Reading reading
    cdef Mirror* mirror = NULL
    pinned.hops = 0
    pinned.has_view = False
    reading_begin(&reading, tree, lock)
    while reading_continue(&reading):
        _unpin_lookup(pinned)
        _pin_lookup(tree, query, pinned)
        mirror = tree.mirror
    return mirror


cdef Py_ssize_t _look_up(const Tree* tree, Lock* lock, const Query* query, PinnedLookup* pinned,
                         const TimeSeries* series, Status* status) noexcept nogil:
    cdef SeriesWork work
    cdef Py_ssize_t start = 0
    cdef uint32_t count = 0
    cdef uint32_t answered = 0
    while start < series.count and answered == count:
        count = <uint32_t>min(<Py_ssize_t>BATCH_TIMES, series.count - start)
        if pinned.by_batches:
            _answer_batch(pinned, series.times_ns + start, count, &work)
        answered = _answer_singly(tree, lock, query, pinned, series, start, count, &work, status)
        if series.points != NULL:
            work_transform_points(&work, answered, series.points + 3 * start, series.transformed + 3 * start)
        else:
            work_store(&work, answered, series.translations + 3 * start, series.rotations + 4 * start)
        start += answered
    return start


cdef Py_ssize_t series_lookup(const Tree* tree, Lock* lock, const Query* query, const TimeSeries* series,
                              Status* status) noexcept nogil:
    cdef PinnedLookup pinned
    cdef Py_ssize_t answered = 0
    cdef uint32_t tries = 0
    cdef bint holds = False
    cdef Mirror* mirror
    while not holds:
        mirror = _pin(tree, lock, query, &pinned)
        if mirror != NULL and tries >= TRIES_IN_PLACE:
            segment_ask_for_pause(mirror.segment, tries - TRIES_IN_PLACE)
        if mirror == NULL or tries < TRIES_IN_PLACE:
            answered = _look_up(tree, lock, query, &pinned, series, status)
            holds = _holds(mirror, &pinned)
        elif _copy_pinned(&pinned) and _holds(mirror, &pinned):
            answered = _look_up(tree, lock, query, &pinned, series, status)
            holds = True
        elif tries == TRIES:
            # Each time by itself: of several states, but no answer is made of two.
            _unpin_lookup(&pinned)
            pinned.hops = 0
            pinned.has_view = pinned.by_batches = False
            answered = _look_up(tree, lock, query, &pinned, series, status)
            holds = True
        _unpin_lookup(&pinned)
        tries += 1
    return answered
