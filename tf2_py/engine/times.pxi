# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Convert times and durations to nanoseconds.

rclpy's Time and Duration keep their number behind two properties, one in Python and one of pybind11. Through
these, a lookup takes 0.8 us instead of 0.45. Reading one directly relies on this: ``_time_handle``, or
``_duration_handle``, is a pybind11 object, which holds, directly after the object head, a pointer to rcl's
``rcl_time_point_t`` or ``rcl_duration_t``, which begin with the nanoseconds. This is checked once, with
objects of known numbers; if it does not hold, the property is called. Tested with rclpy of ROS 2 Jazzy
(CPython 3.10 to 3.13) and Kilted (to 3.14).
"""

TIMES_TO_USE = (
    "Time(seconds=...), node.get_clock().now(), an int of nanoseconds, a datetime64, or Time() for the latest"
)
TIMES_WITHOUT_ROS = "an int of nanoseconds, as round(seconds * 1e9), a datetime64, or 0 for the latest"
DURATION_TO_USE = "Duration(seconds=...)"
# Integers that mean years in seconds, and 0.1 s to a day in nanoseconds.
LIKE_NANOSECONDS = range(10**8, 10**14)
cdef int64_t LONGEST_NS = <int64_t>1 << 62
FOR_EVER_NS = LONGEST_NS     # 146 years; added to a steady time, it still fits into 64 bits

cdef int64_t MAX_SECONDS = INT64_MAX // NS_PER_S

cdef Layout time_layout = None
cdef bint _lacks_rclpy = False      # as the first search found; each takes 40 us, and a lock of imports


cdef int load_time() except -1:
    global time_layout
    if time_layout is None:
        from tf2_py._objects.message_classes import Time
        layout = Layout(Time, ("sec", "nanosec"))
        if time_layout is None:     # else another thread has loaded it meanwhile
            time_layout = layout
    return 0


cdef int64_t whole_number(object value, str field) except? -1:
    try:
        return PyLong_AsLongLong(value)
    except TypeError:
        raise TypeError(f"{field}: expected an int, got {type(value).__name__}") from None
    except OverflowError:
        raise OverflowError(f"{field} = {value} does not fit into 64-bit nanoseconds") from None


cdef int64_t _from_parts(object sec, object nanosec) except? -1:
    cdef int64_t seconds = whole_number(sec, "sec")
    cdef int64_t rest = whole_number(nanosec, "nanosec")
    if -MAX_SECONDS < seconds < MAX_SECONDS and 0 <= rest < NS_PER_S:
        return stamp_join(seconds, rest)
    return whole_number(int(sec) * NS_PER_S + int(nanosec), "sec and nanosec")


cdef object _rclpy_class(str module, str name):
    # None if it was never imported, because then no object of the class exists.
    return getattr(sys.modules.get(f"rclpy.{module}"), name, None)


cdef str _times_to_use():
    return TIMES_WITHOUT_ROS if _rclpy_class("time", "Time") is None else TIMES_TO_USE


cdef inline int64_t* _handle_ns(object handle):
    return (<int64_t**>(<char*><PyObject*>handle + sizeof(PyObject)))[0]


@cython.final
cdef class DirectClass:
    # One of rclpy's two classes.
    cdef str name
    cdef str attribute          # its handle
    cdef object cls             # that was looked at, or None
    cdef object handle_class    # the class of its handles; None: not readable directly
    cdef object assumption

    def __init__(self, str name, str attribute):
        self.name, self.attribute = name, attribute
        self.assumption = Assumption(
            f"{name}.{attribute}", self.holds, f"each use of a {name} takes 0.4 us longer"
        )

    def holds(self):
        cls = _rclpy_class(self.name.lower(), self.name)
        if cls is not None:
            self.look_at(cls)
        return cls is None or self.handle_class is not None

    cdef int look_at(self, cls) except -1:
        self.handle_class = attempt(None, self.class_of_handles, cls)
        self.cls = cls
        if self.handle_class is None:
            self.assumption.report()
        return 0

    def class_of_handles(self, cls):
        cdef int64_t known_ns
        for known_ns in (0x0123456789ABCDEF, 1):
            ordinary = cls(nanoseconds=known_ns)
            handle = getattr(ordinary, self.attribute, None)
            handle_class = type(handle)
            if type(handle_class).__name__ != "pybind11_type" or _handle_ns(handle) == NULL:
                return None
            if _handle_ns(handle)[0] != known_ns or ordinary.nanoseconds != known_ns:
                return None
        return handle_class

    cdef bint read(self, object value, int64_t* found_ns) except -1:
        # False: only its property tells.
        if type(value) is not self.cls or self.handle_class is None:
            return False
        handle = getattr(value, self.attribute)
        if type(handle) is not self.handle_class or _handle_ns(handle) == NULL:
            return False
        found_ns[0] = _handle_ns(handle)[0]
        return True


cdef DirectClass direct_time = DirectClass("Time", "_time_handle")
cdef DirectClass direct_duration = DirectClass("Duration", "_duration_handle")


cdef int64_t nanoseconds(object value, str argument) except? -1:
    cdef int64_t found_ns
    if direct_time.read(value, &found_ns):
        return found_ns
    load_time()
    if type(value) is time_layout.message_class:
        return _from_parts(time_layout.get(value, TIME_SEC), time_layout.get(value, TIME_NANOSEC))
    if PyLong_CheckExact(value):
        return whole_number(value, argument)
    if isinstance(value, datetime.datetime):
        return _datetime64_ns(value, argument)
    # In the timedelta of pandas, `nanoseconds` is only the part below a microsecond.
    if isinstance(value, datetime.timedelta):
        raise _got_duration(type(value).__name__, argument)
    found = getattr(value, "nanoseconds", None)
    if found is not None:
        _refuse_duration(value, found, argument)
        if type(value) is not direct_time.cls and type(value) is _rclpy_class("time", "Time"):
            direct_time.look_at(type(value))
        return whole_number(found, "nanoseconds")
    if hasattr(value, "sec") and hasattr(value, "nanosec"):
        _refuse_duration(value, value.sec or value.nanosec, argument)
        return _from_parts(value.sec, value.nanosec)
    number = _integer(value)
    return _datetime64_ns(value, argument) if number is None else whole_number(number, argument)


cdef int64_t stamp_nanoseconds(object value, str argument) except? -1:
    cdef int64_t stamp_ns = nanoseconds(value, argument)
    if not is_stamp(stamp_ns):
        raise OverflowError(no_stamp(stamp_ns))
    return stamp_ns


cdef inline bint is_stamp(int64_t time_ns) noexcept:
    return MIN_STAMP_NS <= time_ns <= MAX_STAMP_NS


cdef str no_stamp(int64_t time_ns):
    return f"the time {errors.seconds(time_ns)} s does not fit into the stamp of a message"


cdef object _integer(object value):
    # An int, or None. A bool is a mistake, but NumPy's bool is an index in older versions of NumPy. Its
    # timedelta64 calls itself Integral, but is not an index.
    if isinstance(value, bool) or getattr(getattr(value, "dtype", None), "kind", None) == "b":
        return None
    try:
        return operator.index(value)
    except TypeError:
        return None


cdef int64_t _datetime64_ns(object value, str argument) except? -1:
    if hasattr(value, "to_datetime64"):     # of pandas, NaT included; datetime itself may mean any time zone
        value = value.to_datetime64()
    # If NumPy was not imported, no object of its class exists.
    numpy = sys.modules.get("numpy")
    if numpy is None or not isinstance(value, numpy.datetime64):
        raise TypeError(f"{argument}: expected a time, got {type(value).__name__}: use {_times_to_use()}")
    if numpy.isnat(value):
        raise ValueError(f"{argument}: expected a time, got NaT")
    try:
        converted = value.astype("datetime64[ns]")
        is_exact = converted.astype(value.dtype) == value   # NumPy before 2.5 wraps around; later ones raise
    except OverflowError:
        is_exact = False
    if not is_exact:
        raise OverflowError(f"{argument}: expected whole nanoseconds within 64 bits, got {value}")
    return converted.astype("int64")


cdef int _refuse_duration(object value, object amount, str argument) except -1:
    # Programs for tf2 also use a Duration of zero for the latest time.
    if type(value).__name__ != "Duration" or not amount:
        return 0
    for module in ("rclpy.duration", "builtin_interfaces.msg"):
        if isinstance(value, getattr(sys.modules.get(module), "Duration", ())):
            raise _got_duration("a Duration", argument)
    return 0


cdef object _got_duration(str given, str argument):
    # As the third argument of a lookup, it is often meant as the timeout.
    meant = ". Pass a timeout as timeout=" if argument == "time" else ""
    return TypeError(f"{argument}: expected a time, got {given}: use {_times_to_use()}{meant}")


cdef object new_stamp(int64_t stamp_ns):
    cdef int64_t sec
    cdef uint32_t nanosec
    stamp_split(stamp_ns, &sec, &nanosec)
    load_time()
    stamp = time_layout.new()
    time_layout.put(stamp, TIME_SEC, sec)
    time_layout.put(stamp, TIME_NANOSEC, nanosec)
    return stamp


cdef object new_time(int64_t time_ns):
    global _lacks_rclpy
    if not _lacks_rclpy:
        try:
            from rclpy.time import Time
            return Time(nanoseconds=time_ns)
        except ModuleNotFoundError:
            _lacks_rclpy = True
    return new_stamp(time_ns)


def time_ns(time, str argument):
    """
    The nanoseconds of a time: of anything with ``nanoseconds``, or with ``sec`` and ``nanosec``; of an
    integer of nanoseconds; of a ``numpy.datetime64``; or of a ``pandas.Timestamp``.

    :param argument: its name in errors.
    :raises TypeError: it is none of these, or its fields are not integers.
    :raises ValueError: it is NaT.
    :raises OverflowError: it does not fit into 64 bits, or is not a whole number of nanoseconds.
    """
    return nanoseconds(time, argument)


cpdef int64_t duration_ns(object duration, str argument) except? -1:
    """
    The nanoseconds of a duration: of an rclpy ``Duration``, a message, or anything with their fields; of a
    ``datetime.timedelta``; or of a number of seconds.

    :param argument: its name in errors.
    :raises TypeError: it is none of these, or it is a time.
    :raises ValueError: it is NaN.

    Durations beyond plus or minus FOR_EVER_NS, including infinite floats, are limited to it.
    """
    cdef int64_t found_ns
    if direct_duration.read(duration, &found_ns):
        return max(-LONGEST_NS, min(found_ns, LONGEST_NS))
    if PyFloat_CheckExact(duration):
        return _seconds_ns(duration, argument)
    if not PyLong_CheckExact(duration) and _of_fields(duration, argument, &found_ns):
        return found_ns
    seconds = _integer(duration)
    if seconds is not None and seconds in LIKE_NANOSECONDS:
        years = seconds // (365 * 86400)
        text = (f"{argument}={seconds} means {years} years: numbers are seconds. "
                f"For nanoseconds, pass Duration(nanoseconds={seconds})")
        warnings.warn(text, stacklevel=2)   # most callers are methods in Python
    if seconds is None and isinstance(duration, Real) and not isinstance(duration, Integral):
        seconds = float(duration)
    if seconds is None:
        raise TypeError(
            f"{argument}: expected a duration or seconds, "
            f"got {type(duration).__name__}: use {DURATION_TO_USE}"
        )
    if isinstance(seconds, float):
        return _seconds_ns(seconds, argument)
    return _at_most_for_ever(seconds * <object>NS_PER_S)


cdef bint _of_fields(object duration, str argument, int64_t* found_ns) except -1:
    # The rest of duration_ns; False: it is a number, or no duration.
    load_time()
    rclpy_time = _rclpy_class("time", "Time")
    if isinstance(duration, time_layout.message_class) or (
        rclpy_time is not None and isinstance(duration, rclpy_time)
    ):
        raise TypeError(f"{argument}: expected a duration, got a Time: use {DURATION_TO_USE}")
    # In the timedelta of pandas, `nanoseconds` is only the part below a microsecond.
    if isinstance(duration, datetime.timedelta):
        whole_ns = duration // datetime.timedelta(microseconds=1) * 1000
        found_ns[0] = _at_most_for_ever(whole_ns + getattr(duration, "nanoseconds", 0))
        return True
    if hasattr(duration, "nanoseconds"):
        cls = type(duration)
        if cls is not direct_duration.cls and cls is _rclpy_class("duration", "Duration"):
            direct_duration.look_at(cls)
        found_ns[0] = _at_most_for_ever(duration.nanoseconds)
        return True
    if hasattr(duration, "sec") and hasattr(duration, "nanosec"):
        found_ns[0] = _at_most_for_ever(duration.sec * <object>NS_PER_S + duration.nanosec)
        return True
    return False


cdef int64_t _seconds_ns(double seconds, str argument) except? -1:
    cdef double found_ns = seconds * NS_PER_S
    if found_ns != found_ns:
        raise ValueError(f"{argument}: expected a duration or seconds, got NaN: use {DURATION_TO_USE}")
    if found_ns >= <double>LONGEST_NS:
        return LONGEST_NS
    return -LONGEST_NS if found_ns <= -<double>LONGEST_NS else <int64_t>found_ns


cdef object _at_most_for_ever(object duration_ns):
    # Limited before the conversion to an int, because it may be an infinite float.
    return int(max(-FOR_EVER_NS, min(duration_ns, FOR_EVER_NS)))


def stamp_parts(time, str argument):
    """
    The ``(sec, nanosec)`` of a time as a stamp; ``nanosec`` is never negative. Raises as :func:`time_ns`.

    :param argument: its name in errors.
    :raises OverflowError: also if no message can hold it.
    """
    cdef int64_t sec
    cdef uint32_t nanosec
    stamp_split(stamp_nanoseconds(time, argument), &sec, &nanosec)
    return sec, nanosec
