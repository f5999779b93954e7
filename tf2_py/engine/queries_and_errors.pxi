# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The arguments of a lookup, and why it has no answer, as an exception."""

cdef int query_frames(Query* query, object target_frame, object source_frame) except -1:
    query.target = name_utf8(target_frame, &query.target_size, "target_frame")
    query.source = name_utf8(source_frame, &query.source_size, "source_frame")
    query.source_ns = query.target_ns = 0
    query.fixed = NULL
    query.policy.is_given = False
    return 0


cdef int query_at(Query* query, object time, str argument="time") except -1:
    query.source_ns = stamp_nanoseconds(time, argument)
    return require_latest(query, query.source_ns, argument)


cdef int query_fix(Query* query, object fixed_frame, object target_time) except -1:
    query.fixed = name_utf8(fixed_frame, &query.fixed_size, "fixed_frame")
    query.target_ns = stamp_nanoseconds(target_time, "target_time")
    return require_latest(query, query.target_ns, "target_time")


cdef int query_full(Query* query, object target_frame, object source_frame, object fixed_frame,
                    object target_time, PolicyObject policy) except -1:
    if (fixed_frame is None) != (target_time is None):
        raise TypeError("pass both fixed_frame and target_time, or neither")
    query_frames(query, target_frame, source_frame)
    if policy is not None:
        query.policy = policy.policy
    if fixed_frame is not None:
        query_fix(query, fixed_frame, target_time)
    return 0


cdef int require_latest(const Query* query, int64_t time_ns, str argument) except -1:
    if time_ns != 0 and query.policy.is_given and query.policy.judges_age:
        raise ValueError(f"max_age limits the age of the latest transform, so {argument} must be 0, "
                         f"got {errors.seconds(time_ns)} s; for a time, use tolerance")
    return 0


cdef class PolicyObject:
    """What a lookup accepts beyond tf2's; made by :func:`policy_of`."""

    def __cinit__(self):
        self._names = []

    def __dealloc__(self):
        free(<void*>self.policy.tolerance.named)
        free(<void*>self.policy.max_age.named)

    @property
    def judges_age(self):
        """Whether an answer that was accepted may be refused later, because it has become older."""
        return self.policy.judges_age

    cdef int _read_limits(self, FrameLimits* limits, object given, str argument, int64_t others_ns) except -1:
        cdef FrameLimit* named
        cdef bint is_one = PyFloat_CheckExact(given) or type(given) is direct_duration.cls
        if is_one or not isinstance(given, Mapping):    # which takes longer than the lookup
            limits.others_ns = _not_negative(given, argument)
            return 0
        limits.others_ns = others_ns
        items = list(given.items())
        named = <FrameLimit*>calloc(len(items) + 1, sizeof(FrameLimit))
        if named == NULL:
            raise MemoryError
        limits.named = named
        for frame, duration in items:
            named[limits.count].name = name_utf8(frame, &named[limits.count].size, f"a frame of {argument}")
            named[limits.count].limit_ns = _not_negative(duration, f"{argument}[{frame!r}]")
            self._names.append(frame)
            limits.count += 1
        return 0


cpdef bint bool_of(object value, str argument) except -1:
    """A bool, or one of NumPy; anything else is a TypeError, because ``"no"`` and NaN would count as true."""
    if value is True or value is False:
        return value is True
    if type(value).__module__ != "numpy" or type(value).__name__ not in ("bool", "bool_"):
        raise TypeError(f"{argument}: expected a bool, got {type(value).__name__}")
    return bool(value)


cdef int64_t _not_negative(object duration, str argument) except -1:
    # INT64_MAX: without end.
    cdef int64_t found_ns = duration_ns(duration, argument)
    if found_ns < 0:
        given = "-inf" if found_ns <= -LONGEST_NS else errors.seconds(found_ns)
        raise ValueError(f"{argument} must not be negative, got {given} s")
    return INT64_MAX if found_ns >= LONGEST_NS else found_ns


cdef str _unexpected(str name, str call, waits):
    from tf2_py.typing import LookupPolicy      # needs NumPy

    text = f"{call}() got an unexpected keyword argument {name!r}"
    meant = frame_names.closest(name, ("timeout", *LookupPolicy.__annotations__))
    if meant and meant[0] == "timeout" and not waits:
        text += ". It does not wait: first call lookup_transform or can_transform with a timeout"
    elif meant:
        text += f". Did you mean {meant[0]!r}?"
    return text


def policy_of(call, waits, /, **policy):
    """
    The policy of these arguments, those of :class:`tf2_py.typing.LookupPolicy`; None: all are defaults.

    :param call: the method that a program called with them.
    :param waits: whether it has a ``timeout``.
    :raises TypeError: one of them has the wrong type, or there are others.
    :raises ValueError: a duration is negative.
    """
    cdef PolicyObject made
    tolerance = policy.pop("tolerance", None)
    extrapolate = policy.pop("extrapolate", None)
    cdef bint extrapolates = extrapolate is not None and bool_of(extrapolate, "extrapolate")
    max_gap = policy.pop("max_gap", None)
    max_age = policy.pop("max_age", None)
    for name in policy:
        raise TypeError(_unexpected(name, call, waits))
    if tolerance is None and extrapolates:
        raise TypeError("extrapolate needs a tolerance, which limits how far to extrapolate")
    if tolerance is None and max_gap is None and max_age is None:
        return None
    made = PolicyObject()
    made.policy.is_given = True
    made.policy.extrapolates = extrapolates
    made.policy.max_gap_ns = INT64_MAX if max_gap is None else _not_negative(max_gap, "max_gap")
    if tolerance is not None:
        made._read_limits(&made.policy.tolerance, tolerance, "tolerance", 0)
    if max_age is not None:
        made.policy.judges_age = True
        made._read_limits(&made.policy.max_age, max_age, "max_age", INT64_MAX)
    return made


def frame_name(name, str argument):
    """The name, if lookups accept it; otherwise raises the errors of a lookup."""
    cdef Py_ssize_t size
    name_utf8(name, &size, argument)
    return name


# The status of a lookup as an exception.

# Of the gaps that tf2's sentence can describe.
cdef dict GAP_NAMES = {GAP_EMPTY: "empty", GAP_SINGLE: "single", GAP_FUTURE: "future", GAP_PAST: "past"}


cdef tuple query_names(const Query* query):
    return (
        query.target[:query.target_size].decode("utf-8"),
        query.source[:query.source_size].decode("utf-8"),
        None if query.fixed == NULL else query.fixed[:query.fixed_size].decode("utf-8"),
    )


cdef tuple _ends(const Query* query, Status status):
    # As in tf2, which does a two-time lookup in halves, the text names the ends of the half that failed.
    target, source, fixed = query_names(query)
    if status.half == HALF_SOURCE:
        target = fixed
    elif status.half == HALF_TARGET:
        source = fixed
    return target, source


cdef object name_error(str name, str argument, str call, Advice advice, object list_names):
    if frame_names.is_invalid_name(name):
        return errors.bad_name(name, argument, call)
    unknown = str(errors.bad_name(name, argument, call))
    return errors.LookupException(advice.extend(unknown, name, list_names))


cdef object _bad_limit(const Query* query, Status status, bint is_static, list instead, str call,
                       Advice advice, object list_names):
    cdef uint32_t tolerances = query.policy.tolerance.count
    cdef const FrameLimit* limit
    if status.parent < tolerances:
        argument, limit = "tolerance", &query.policy.tolerance.named[status.parent]
    else:
        argument, limit = "max_age", &query.policy.max_age.named[status.parent - tolerances]
    name = limit.name[:limit.size].decode("utf-8")
    if instead is None:
        return ValueError(advice.extend(errors.limit_of_unknown(name, argument, call), name, list_names))
    return ValueError(errors.limit_without_effect(name, argument, is_static, instead))


cdef object query_error(const Query* query, Status status, str child, str parent, list instead,
                        str limiting, str call, Advice advice, object buffer, ClockHook clock):
    cdef uint32_t index
    cdef bytes name
    target, source, fixed = query_names(query)
    if status.code == STATUS_BAD_TARGET:
        return name_error(target, "target_frame", call, advice, buffer._tf2_names)
    if status.code == STATUS_BAD_SOURCE:
        return name_error(source, "source_frame", call, advice, buffer._tf2_names)
    if status.code == STATUS_BAD_FIXED:
        return name_error(fixed, "fixed_frame", call, advice, buffer._tf2_names)
    if status.code == STATUS_BAD_LIMIT:
        return _bad_limit(query, status, parent is not None, instead, call, advice, buffer._tf2_names)
    target, source = _ends(query, status)
    if status.code == STATUS_UNCONNECTED:
        error = errors.unconnected(target, source, parent, child)
        return advice.with_silence(error, buffer, dynamic_only=False)
    if status.code == STATUS_LOOP:
        return errors.loop(target, source)
    if status.gap == GAP_LONG:
        return errors.long_gap(
            child, status.requested_ns, status.edge_ns, status.other_ns, query.policy.max_gap_ns,
            target, source,
        )
    if status.gap == GAP_STALE:
        error = errors.stale(
            child, parent, status.edge_ns, status.requested_ns, status.other_ns, target, source,
        )
        return advice.with_silence(error, buffer, dynamic_only=True)
    name = child.encode("utf-8")
    error = errors.extrapolation(
        status.requested_ns, GAP_NAMES[status.quoted_gap], status.other_ns, target, source,
        GAP_NAMES[status.gap], status.edge_ns, child, parent, limiting,
        limit_of_name(&query.policy.tolerance, name, len(name), &index) if query.policy.is_given else 0,
        # Reading a clock costs as much as the rest, and only a time after the data may be ahead of it.
        clock.now_ns() if clock is not None and status.edge_ns < status.requested_ns else 0,
    )
    # Data that may still arrive does not help with the past.
    if status.gap == GAP_EMPTY or status.requested_ns > status.edge_ns:
        return advice.with_silence(error, buffer, dynamic_only=True)
    return error
