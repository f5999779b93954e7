"""Owns turning the status of a lookup into an exception, or into what a wait for it lacks."""

from tf2_py._core.lookup cimport Query
from tf2_py._core.types cimport (
    GAP_EMPTY,
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
from tf2_py._objects.advice cimport Advice

from tf2_py._objects import errors, wait_texts
from tf2_py._objects.frame_names import is_invalid_name

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


cdef object _bad_name(str name, str argument, str call, Advice advice, object list_names):
    if is_invalid_name(name):
        return errors.bad_name(name, argument, call)
    return errors.LookupException(advice.unknown(name, argument, call, list_names))


cdef object query_error(const Query* query, Status status, str child, str parent, str call, Advice advice,
                        object buffer):
    target, source, fixed = _names(query)
    if status.code == STATUS_BAD_TARGET:
        return _bad_name(target, "target_frame", call, advice, buffer._known_names)
    if status.code == STATUS_BAD_SOURCE:
        return _bad_name(source, "source_frame", call, advice, buffer._known_names)
    if status.code == STATUS_BAD_FIXED:
        return _bad_name(fixed, "fixed_frame", call, advice, buffer._known_names)
    target, source = _ends(query, status)
    if status.code == STATUS_UNCONNECTED:
        return advice.with_silence(errors.unconnected(target, source), buffer, dynamic_only=False)
    if status.code == STATUS_LOOP:
        return errors.loop(target, source)
    error = errors.extrapolation(
        GAP_NAMES[<int>status.gap], child, parent, status.requested_ns, status.edge_ns, target, source
    )
    # What could still arrive does not help with the past.
    if status.gap == GAP_EMPTY or status.requested_ns > status.edge_ns:
        return advice.with_silence(error, buffer, dynamic_only=True)
    return error


cdef str query_lack(const Query* query, Status status, str child, Advice advice, object list_names):
    target, source, fixed = _names(query)
    lack = unknown = None
    if status.code == STATUS_BAD_TARGET:
        unknown = target
    elif status.code == STATUS_BAD_SOURCE:
        unknown = source
    elif status.code == STATUS_BAD_FIXED:
        unknown = fixed
    elif status.code == STATUS_UNCONNECTED:
        lack = wait_texts.unconnected(*_ends(query, status))
    elif status.code == STATUS_LOOP:
        lack = wait_texts.loop(*_ends(query, status))
    elif status.code != STATUS_OK:
        lack = wait_texts.data(GAP_NAMES[<int>status.gap], child, status.requested_ns, status.edge_ns)
    if unknown is not None:
        lack = ". ".join(filter(None, (wait_texts.unknown(unknown), advice.suggestion(unknown, list_names))))
    target_ns = query.source_ns if query.fixed == NULL else query.target_ns
    return wait_texts.waits_for(target, target_ns, source, query.source_ns, fixed, lack)
