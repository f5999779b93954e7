"""Owns turning the status of a lookup into an exception, or into what a wait for it lacks."""

from tf2_py._core.lookup cimport Query
from tf2_py._core.types cimport (
    HALF_SOURCE,
    HALF_TARGET,
    STATUS_BAD_FIXED,
    STATUS_BAD_SOURCE,
    STATUS_BAD_TARGET,
    STATUS_LOOP,
    STATUS_OK,
    STATUS_UNCONNECTED,
    Status,
)

from tf2_py._objects import errors, wait_texts

cdef tuple GAP_NAMES = ("none", "empty", "single", "future", "past")


cdef tuple _names(const Query* query):
    # Target, source, fixed frame or None.
    return (
        query.target[:query.target_size].decode("utf-8"),
        query.source[:query.source_size].decode("utf-8"),
        None if query.fixed == NULL else query.fixed[:query.fixed_size].decode("utf-8"),
    )


cdef tuple _ends(const Query* query, Status status):
    # As tf2, which does a two-time lookup in halves: the text names the ends of the half that failed.
    target, source, fixed = _names(query)
    if status.half == HALF_SOURCE:
        target = fixed
    elif status.half == HALF_TARGET:
        source = fixed
    return target, source


cdef object query_error(const Query* query, Status status, str child, str parent, str call):
    target, source, fixed = _names(query)
    if status.code == STATUS_BAD_TARGET:
        return errors.bad_name(target, "target_frame", call)
    if status.code == STATUS_BAD_SOURCE:
        return errors.bad_name(source, "source_frame", call)
    if status.code == STATUS_BAD_FIXED:
        return errors.bad_name(fixed, "fixed_frame", call)
    target, source = _ends(query, status)
    if status.code == STATUS_UNCONNECTED:
        return errors.unconnected(target, source)
    if status.code == STATUS_LOOP:
        return errors.loop(target, source)
    return errors.extrapolation(
        GAP_NAMES[<int>status.gap], child, parent, status.requested_ns, status.edge_ns, target, source
    )


cdef str query_lack(const Query* query, Status status, str child):
    target, source, fixed = _names(query)
    lack = None
    if status.code == STATUS_BAD_TARGET:
        lack = wait_texts.unknown(target)
    elif status.code == STATUS_BAD_SOURCE:
        lack = wait_texts.unknown(source)
    elif status.code == STATUS_BAD_FIXED:
        lack = wait_texts.unknown(fixed)
    elif status.code == STATUS_UNCONNECTED:
        lack = wait_texts.unconnected(*_ends(query, status))
    elif status.code == STATUS_LOOP:
        lack = wait_texts.loop(*_ends(query, status))
    elif status.code != STATUS_OK:
        lack = wait_texts.data(GAP_NAMES[<int>status.gap], child, status.requested_ns, status.edge_ns)
    target_ns = query.source_ns if query.fixed == NULL else query.target_ns
    return wait_texts.waits_for(target, target_ns, source, query.source_ns, fixed, lack)
