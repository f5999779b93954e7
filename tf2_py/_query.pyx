"""Owns a lookup as its caller words it: names and times on the way in, an exception on the way out."""

from libc.stdint cimport int64_t
from libc.string cimport memcmp, memset

from tf2_py._geometry cimport quaternion_canonicalise, transform_compose
from tf2_py._messages cimport name_utf8, time_to_ns
from tf2_py._tree cimport Tree, tree_frame
from tf2_py._types cimport (
    HALF_SOURCE,
    HALF_TARGET,
    MAX_STAMP_NS,
    MIN_STAMP_NS,
    NO_FRAME,
    STATUS_BAD_FIXED,
    STATUS_BAD_SOURCE,
    STATUS_BAD_TARGET,
    STATUS_LOOP,
    STATUS_OK,
    STATUS_UNCONNECTED,
    FrameId,
    Status,
    StatusCode,
    Transform,
)
from tf2_py._walk cimport Path, walk_lookup

from tf2_py import _errors

cdef tuple GAP_NAMES = ("none", "empty", "single", "future", "past")


cdef int64_t query_time(object time) except? -1:
    cdef int64_t time_ns = time_to_ns(time)
    if not MIN_STAMP_NS <= time_ns <= MAX_STAMP_NS:
        raise OverflowError(f"the time {_errors.seconds(time_ns)} s does not fit into the stamp of a message")
    return time_ns


cdef int query_fill(Query* query, object target_frame, object source_frame, object time) except -1:
    query.target = name_utf8(target_frame, &query.target_size)
    query.source = name_utf8(source_frame, &query.source_size)
    query.fixed = NULL
    query.source_ns = query_time(time)
    return 0


cdef int query_fill_full(Query* query, object target_frame, object target_time, object source_frame,
                         object source_time, object fixed_frame) except -1:
    query_fill(query, target_frame, source_frame, source_time)
    query.fixed = name_utf8(fixed_frame, &query.fixed_size)
    query.target_ns = query_time(target_time)
    return 0


cdef inline FrameId _frame(const Tree* tree, const char* name, Py_ssize_t size) noexcept nogil:
    # NO_FRAME for every name that no lookup accepts.
    if size == 0 or name[0] == b"/":
        return NO_FRAME
    return tree_frame(tree, name, size)


cdef inline Status _status(StatusCode code) noexcept nogil:
    cdef Status status
    memset(&status, 0, sizeof(Status))
    status.code = code
    return status


cdef Status query_ends(const Tree* tree, const Query* query, FrameId* target, FrameId* source) noexcept nogil:
    target[0] = _frame(tree, query.target, query.target_size)
    source[0] = _frame(tree, query.source, query.source_size)
    if target[0] == NO_FRAME:
        return _status(STATUS_BAD_TARGET)
    if source[0] == NO_FRAME:
        return _status(STATUS_BAD_SOURCE)
    return _status(STATUS_OK)


cdef FrameId query_fixed(const Tree* tree, const Query* query) noexcept nogil:
    return _frame(tree, query.fixed, query.fixed_size)


cdef bint query_is_identity(const Query* query) noexcept nogil:
    # Equal names in a simple lookup need no frame that anyone has seen.
    return (query.fixed == NULL and query.target_size == query.source_size
            and memcmp(query.target, query.source, query.source_size) == 0)


cdef Status query_walk(const Tree* tree, const Query* query, Transform* out,
                       int64_t* stamp_ns) noexcept nogil:
    # Both lookups of tf2, with the lock held; `out` NULL only asks whether there is an answer.
    cdef Path path
    cdef FrameId target, source, fixed
    cdef Status status
    cdef Transform source_half
    cdef int64_t source_stamp_ns
    if query_is_identity(query):
        source = tree_frame(tree, query.source, query.source_size)
        return walk_lookup(tree, source, source, query.source_ns, &path, out, stamp_ns)
    status = query_ends(tree, query, &target, &source)
    if status.code != STATUS_OK:
        return status
    if query.fixed == NULL:
        return walk_lookup(tree, target, source, query.source_ns, &path, out, stamp_ns)
    fixed = query_fixed(tree, query)
    if fixed == NO_FRAME:
        return _status(STATUS_BAD_FIXED)
    if out == NULL:
        # Which half fails first shows in the reason: can_transform begins with the target's ...
        status = walk_lookup(tree, target, fixed, query.target_ns, &path, NULL, stamp_ns)
        status.half = HALF_TARGET
        if status.code != STATUS_OK:
            return status
        status = walk_lookup(tree, fixed, source, query.source_ns, &path, NULL, &source_stamp_ns)
        status.half = HALF_SOURCE
        return status
    # ... the lookup with the source's.
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


cdef object query_error(const Query* query, Status status, str child, str parent, str call):
    cdef str target = query.target[:query.target_size].decode("utf-8")
    cdef str source = query.source[:query.source_size].decode("utf-8")
    cdef str fixed = None
    if query.fixed != NULL:
        fixed = query.fixed[:query.fixed_size].decode("utf-8")
    if status.code == STATUS_BAD_TARGET:
        return _errors.bad_name(target, "target_frame", call)
    if status.code == STATUS_BAD_SOURCE:
        return _errors.bad_name(source, "source_frame", call)
    if status.code == STATUS_BAD_FIXED:
        return _errors.bad_name(fixed, "fixed_frame", call)
    # As tf2, which does a two-time lookup in halves: the text names the ends of the half that failed.
    if status.half == HALF_SOURCE:
        target = fixed
    elif status.half == HALF_TARGET:
        source = fixed
    if status.code == STATUS_UNCONNECTED:
        return _errors.unconnected(target, source)
    if status.code == STATUS_LOOP:
        return _errors.loop(target, source)
    return _errors.extrapolation(
        GAP_NAMES[<int>status.gap], child, parent, status.requested_ns, status.edge_ns, target, source
    )
