"""Owns the lookup: names to frames, the walk between them, the halves of a two-time lookup."""

from libc.stdint cimport int64_t
from libc.string cimport memcmp

from tf2_py._core.geometry cimport quaternion_canonicalise, transform_compose
from tf2_py._core.names cimport name_is_invalid
from tf2_py._core.path cimport Path
from tf2_py._core.tree cimport Tree, tree_frame
from tf2_py._core.types cimport (
    HALF_SOURCE,
    HALF_TARGET,
    NO_FRAME,
    STATUS_BAD_FIXED,
    STATUS_BAD_SOURCE,
    STATUS_BAD_TARGET,
    STATUS_OK,
    FrameId,
    Status,
    Transform,
    status_of,
)
from tf2_py._core.walk cimport walk_lookup

cdef inline FrameId _frame(const Tree* tree, const char* name, Py_ssize_t size) noexcept nogil:
    return NO_FRAME if name_is_invalid(name, size) else tree_frame(tree, name, size)


cdef Status query_end_frames(const Tree* tree, const Query* query, FrameId* target,
                             FrameId* source) noexcept nogil:
    target[0] = _frame(tree, query.target, query.target_size)
    source[0] = _frame(tree, query.source, query.source_size)
    if target[0] == NO_FRAME:
        return status_of(STATUS_BAD_TARGET)
    if source[0] == NO_FRAME:
        return status_of(STATUS_BAD_SOURCE)
    return status_of(STATUS_OK)


cdef FrameId query_fixed_frame(const Tree* tree, const Query* query) noexcept nogil:
    return _frame(tree, query.fixed, query.fixed_size)


cdef bint query_is_identity(const Query* query) noexcept nogil:
    return (query.fixed == NULL and query.target_size == query.source_size
            and memcmp(query.target, query.source, query.source_size) == 0)


cdef Status query_answer(const Tree* tree, const Query* query, Transform* out,
                         int64_t* stamp_ns) noexcept nogil:
    cdef Path path
    cdef FrameId target, source, fixed
    cdef Status status
    cdef Transform source_half
    cdef int64_t source_stamp_ns
    if query_is_identity(query):
        source = tree_frame(tree, query.source, query.source_size)
        return walk_lookup(tree, source, source, query.source_ns, &path, out, stamp_ns)
    status = query_end_frames(tree, query, &target, &source)
    if status.code != STATUS_OK:
        return status
    if query.fixed == NULL:
        return walk_lookup(tree, target, source, query.source_ns, &path, out, stamp_ns)
    fixed = query_fixed_frame(tree, query)
    if fixed == NO_FRAME:
        return status_of(STATUS_BAD_FIXED)
    if out == NULL:
        # The reason tells which half fails first. tf2's can_transform begins with the target's ...
        status = walk_lookup(tree, target, fixed, query.target_ns, &path, NULL, stamp_ns)
        status.half = HALF_TARGET
        if status.code != STATUS_OK:
            return status
        status = walk_lookup(tree, fixed, source, query.source_ns, &path, NULL, &source_stamp_ns)
        status.half = HALF_SOURCE
        return status
    # ... and its lookup with the source's.
    status = walk_lookup(tree, fixed, source, query.source_ns, &path, &source_half, &source_stamp_ns)
    status.half = HALF_SOURCE
    if status.code != STATUS_OK:
        return status
    status = walk_lookup(tree, target, fixed, query.target_ns, &path, out, stamp_ns)
    status.half = HALF_TARGET
    if status.code != STATUS_OK:
        return status
    transform_compose(out, &source_half, out)
    quaternion_canonicalise(out.rotation)
    return status
