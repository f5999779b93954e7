"""Owns turning the status of a lookup into an exception."""

from tf2_py._core.lookup cimport Query
from tf2_py._core.types cimport (
    HALF_SOURCE,
    HALF_TARGET,
    STATUS_BAD_FIXED,
    STATUS_BAD_SOURCE,
    STATUS_BAD_TARGET,
    STATUS_LOOP,
    STATUS_UNCONNECTED,
    Status,
)

from tf2_py._objects import errors

cdef tuple GAP_NAMES = ("none", "empty", "single", "future", "past")


cdef object query_error(const Query* query, Status status, str child, str parent, str call):
    cdef str target = query.target[:query.target_size].decode("utf-8")
    cdef str source = query.source[:query.source_size].decode("utf-8")
    cdef str fixed = None
    if query.fixed != NULL:
        fixed = query.fixed[:query.fixed_size].decode("utf-8")
    if status.code == STATUS_BAD_TARGET:
        return errors.bad_name(target, "target_frame", call)
    if status.code == STATUS_BAD_SOURCE:
        return errors.bad_name(source, "source_frame", call)
    if status.code == STATUS_BAD_FIXED:
        return errors.bad_name(fixed, "fixed_frame", call)
    # As tf2, which does a two-time lookup in halves: the text names the ends of the half that failed.
    if status.half == HALF_SOURCE:
        target = fixed
    elif status.half == HALF_TARGET:
        source = fixed
    if status.code == STATUS_UNCONNECTED:
        return errors.unconnected(target, source)
    if status.code == STATUS_LOOP:
        return errors.loop(target, source)
    return errors.extrapolation(
        GAP_NAMES[<int>status.gap], child, parent, status.requested_ns, status.edge_ns, target, source
    )
