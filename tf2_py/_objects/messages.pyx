"""Owns the traffic between message objects and C structs; the only room that imports message packages."""

cimport cython
from cpython.float cimport PyFloat_AS_DOUBLE, PyFloat_AsDouble, PyFloat_CheckExact, PyFloat_FromDouble
from cpython.long cimport PyLong_AsLongLong
from cpython.object cimport PyObject, PyTypeObject
from cpython.ref cimport Py_INCREF
from cpython.unicode cimport PyUnicode_Check
from libc.float cimport DBL_EPSILON
from libc.math cimport isfinite
from libc.stdint cimport INT64_MAX, int64_t
from libc.string cimport memchr

from tf2_py._core.geometry cimport quaternion_normalise
from tf2_py._core.types cimport Incoming, Transform

import sys
import types

from tf2_py._objects.errors import MalformedObjectError

cdef extern from "Python.h":
    ctypedef struct PyMemberDef:
        int type
        Py_ssize_t offset
    ctypedef struct PyMemberDescrObject:
        PyMemberDef* d_member
    object PyType_GenericAlloc(PyTypeObject* cls, Py_ssize_t count)
    const char* PyUnicode_AsUTF8AndSize(object text, Py_ssize_t* size) except NULL

cdef enum:
    SLOT_OBJECT = 16        # T_OBJECT_EX, what __slots__ makes
    NS_PER_S = 1000000000

cdef int64_t MAX_SECONDS = INT64_MAX // NS_PER_S


@cython.final
cdef class Layout:
    def __init__(self, message_class, tuple fields):
        self.message_class = message_class
        self.fields = fields
        self.by_slot = self._find_slots()

    cdef bint _find_slots(self) except -1:
        cdef Py_ssize_t i
        cls = self.message_class
        slots = [name for base in cls.__mro__ for name in base.__dict__.get("__slots__", ())]
        prefix = "_" if all("_" + name in slots for name in self.fields) else ""
        expected = {prefix + name for name in self.fields}
        if set(slots) - {"_check_fields"} != expected or len(self.fields) > MAX_FIELDS:
            return False
        if cls.__dictoffset__ or cls.__new__ is not object.__new__:
            return False
        for i, name in enumerate(self.fields):
            self.offsets[i] = _slot_offset(cls, prefix + name)
        self.check_offset = _slot_offset(cls, "_check_fields") if "_check_fields" in slots else 0
        if self.check_offset < 0 or min(self.offsets[i] for i in range(len(self.fields))) <= 0:
            return False
        # The proof: an ordinary message has at these places just what its attributes say.
        ordinary = cls()
        for i, name in enumerate(self.fields):
            value = getattr(ordinary, name)
            if _slot(ordinary, self.offsets[i])[0] != <PyObject*>value:
                return False
        if self.check_offset:
            self.check_fields = ordinary._check_fields
        return True

    cdef object new(self):
        if not self.by_slot:
            return self.message_class()
        message = PyType_GenericAlloc(<PyTypeObject*>self.message_class, 0)
        if self.check_offset:
            Py_INCREF(self.check_fields)
            _slot(message, self.check_offset)[0] = <PyObject*>self.check_fields
        return message

    cdef PyObject* peek(self, object message, int index) noexcept:
        if self.by_slot and type(message) is self.message_class:
            return _slot(message, self.offsets[index])[0]
        return NULL

    cdef object get(self, object message, int index):
        cdef PyObject* value = self.peek(message, index)
        if value != NULL:
            return <object>value
        return getattr(message, self.fields[index])

    cdef int put(self, object message, int index, object value) except -1:
        if self.by_slot:
            Py_INCREF(value)
            _slot(message, self.offsets[index])[0] = <PyObject*>value
        else:
            setattr(message, self.fields[index], value)
        return 0

    cdef int get_doubles(self, object message, double* out, int count) except -1:
        cdef int i
        for i in range(count):
            value = self.get(message, i)
            out[i] = PyFloat_AS_DOUBLE(value) if PyFloat_CheckExact(value) else PyFloat_AsDouble(value)
        return 0

    cdef object new_doubles(self, const double* values, int count):
        cdef int i
        message = self.new()
        for i in range(count):
            self.put(message, i, PyFloat_FromDouble(values[i]))
        return message


cdef inline PyObject** _slot(object message, Py_ssize_t offset):
    return <PyObject**>(<char*><PyObject*>message + offset)


cdef Py_ssize_t _slot_offset(cls, str name):
    # -1 where the attribute is not a slot that holds an object.
    cdef PyMemberDef* member
    descriptor = getattr(cls, name, None)
    if type(descriptor) is not types.MemberDescriptorType:
        return -1
    member = (<PyMemberDescrObject*>descriptor).d_member
    return member.offset if member.type == SLOT_OBJECT else -1


cdef Layout time_layout = None
cdef Layout header_layout = None
cdef Layout vector3_layout = None
cdef Layout quaternion_layout = None
cdef Layout transform_layout = None
cdef Layout transform_stamped_layout = None


cdef int load() except -1:
    """Import the message packages, once, when the first message is read or made."""
    global time_layout, header_layout, vector3_layout, quaternion_layout, transform_layout
    global transform_stamped_layout
    if transform_stamped_layout is not None:
        return 0
    try:
        from builtin_interfaces.msg import Time
        from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
        from std_msgs.msg import Header
    except ModuleNotFoundError as missing:
        if missing.name not in ("builtin_interfaces", "geometry_msgs", "std_msgs"):
            raise
        from tf2_py._objects.standins import Header, Quaternion, Time, Transform, TransformStamped, Vector3
    time_layout = Layout(Time, ("sec", "nanosec"))
    header_layout = Layout(Header, ("stamp", "frame_id"))
    vector3_layout = Layout(Vector3, ("x", "y", "z"))
    quaternion_layout = Layout(Quaternion, ("x", "y", "z", "w"))
    transform_layout = Layout(Transform, ("translation", "rotation"))
    transform_stamped_layout = Layout(TransformStamped, ("header", "child_frame_id", "transform"))
    return 0


cdef const char* name_utf8(object name, Py_ssize_t* size) except NULL:
    cdef const char* text
    if not PyUnicode_Check(name):
        raise TypeError(f"a frame name must be a str, not {type(name).__name__}")
    text = PyUnicode_AsUTF8AndSize(name, size)
    if memchr(text, 0, size[0]) != NULL:
        raise ValueError(f"a frame name cannot hold a NUL character: {name!r}")
    return text


cdef int64_t _whole(object value, str field) except? -1:
    try:
        return PyLong_AsLongLong(value)
    except TypeError:
        raise TypeError(f"{field} must be an int, not {type(value).__name__}") from None
    except OverflowError:
        raise OverflowError(f"{field} = {value} does not fit into 64-bit nanoseconds") from None


cdef int64_t _from_parts(object sec, object nanosec) except? -1:
    cdef int64_t seconds = _whole(sec, "sec")
    cdef int64_t rest = _whole(nanosec, "nanosec")
    if -MAX_SECONDS < seconds < MAX_SECONDS and 0 <= rest < NS_PER_S:
        return seconds * NS_PER_S + rest
    return _whole(int(sec) * NS_PER_S + int(nanosec), "sec and nanosec")


# rclpy's Time keeps its number in a pybind11 object, whose property takes 0.1 us to call. That object holds a
# pointer to rcl's struct, which begins with the nanoseconds: they are read there once a look at known times
# has found them there.
cdef object _time_class = None      # the class that was looked at, or None
cdef object _handle_class = None    # the class of its handles; None: not readable directly


cdef object _rclpy_time():
    # None where nobody has imported it, and so nobody can have made one.
    return getattr(sys.modules.get("rclpy.time"), "Time", None)


cdef inline int64_t* _handle_ns(object handle):
    return (<int64_t**>(<char*><PyObject*>handle + sizeof(PyObject)))[0]


cdef int _look_at_time_class(cls) except -1:
    global _time_class, _handle_class
    cdef int64_t known_ns
    _time_class = cls
    _handle_class = None
    for known_ns in (0x0123456789ABCDEF, 1):
        handle = getattr(cls(nanoseconds=known_ns), "_time_handle", None)
        handle_class = type(handle)
        if type(handle_class).__name__ != "pybind11_type" or _handle_ns(handle) == NULL \
                or _handle_ns(handle)[0] != known_ns:
            return 0
    _handle_class = handle_class
    return 0


cdef int64_t _nanoseconds(object value, str what) except? -1:
    if type(value) is _time_class and _handle_class is not None:
        handle = value._time_handle
        if type(handle) is _handle_class and _handle_ns(handle) != NULL:
            return _handle_ns(handle)[0]
    load()
    if type(value) is time_layout.message_class:
        return _from_parts(time_layout.get(value, 0), time_layout.get(value, 1))
    nanoseconds = getattr(value, "nanoseconds", None)
    if nanoseconds is not None:
        if type(value) is not _time_class and type(value) is _rclpy_time():
            _look_at_time_class(type(value))
        return _whole(nanoseconds, "nanoseconds")
    try:
        sec, nanosec = value.sec, value.nanosec
    except AttributeError:
        raise TypeError(
            f"{what} must have nanoseconds, or sec and nanosec; {type(value).__name__} has neither"
        ) from None
    return _from_parts(sec, nanosec)


cdef int64_t time_to_ns(object time) except? -1:
    return _nanoseconds(time, "a time")


cdef int64_t duration_to_ns(object duration) except? -1:
    return _nanoseconds(duration, "a duration")


cdef int _read_transform(object transform, Transform* out) except -1:
    vector3_layout.get_doubles(transform_layout.get(transform, 0), out.translation, 3)
    quaternion_layout.get_doubles(transform_layout.get(transform, 1), out.rotation, 4)
    return 0


cdef _misfit(object message, str wanted, AttributeError missing):
    return MalformedObjectError(
        f"expected {wanted} or an object with its fields, got {type(message).__name__}: {missing}"
    )


cdef int read_any_rotation(object message, Transform* out) except -1:
    cdef double squared
    cdef double* q = out.rotation
    load()
    try:
        if type(message) is transform_stamped_layout.message_class:
            message = transform_stamped_layout.get(message, 2)
        elif hasattr(message, "transform"):
            message = message.transform
        _read_transform(message, out)
    except AttributeError as missing:
        raise _misfit(message, "a geometry_msgs/TransformStamped or Transform", missing) from None
    squared = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    if not isfinite(squared):
        raise ValueError("the rotation of a transform must have a finite length")
    if squared < DBL_EPSILON:
        q[0] = q[1] = q[2] = 0.0
        q[3] = 1.0
    return 0


cdef int read_transform(object message, Transform* out) except -1:
    read_any_rotation(message, out)
    quaternion_normalise(out.rotation)
    return 0


cdef int read_transform_stamped(object message, Incoming* out, list keep) except -1:
    cdef Py_ssize_t size
    load()
    try:
        header = transform_stamped_layout.get(message, 0)
        child = transform_stamped_layout.get(message, 1)
        transform = transform_stamped_layout.get(message, 2)
        parent = header_layout.get(header, 1)
        _read_transform(transform, &out.transform)
        out.stamp_ns = time_to_ns(header_layout.get(header, 0))
    except AttributeError as missing:
        raise _misfit(message, "a geometry_msgs/TransformStamped", missing) from None
    # Last, so that no Python code runs between taking these pointers and using them.
    out.parent = name_utf8(parent, &size)
    out.parent_size = size
    out.child = name_utf8(child, &size)
    out.child_size = size
    if keep is not None:
        keep.append(parent)
        keep.append(child)
    return 0


cdef inline bint _is_plain(Layout layout, object message, int count):
    # Of this very class, and its first `count` fields floats.
    cdef int i
    if not layout.by_slot or type(message) is not layout.message_class:
        return False
    for i in range(count):
        if not PyFloat_CheckExact(layout.get(message, i)):
            return False
    return True


cdef bint is_plain_transform_stamped(object message) except -1:
    load()
    if not (_is_plain(transform_stamped_layout, message, 0)):
        return False
    header = transform_stamped_layout.get(message, 0)
    transform = transform_stamped_layout.get(message, 2)
    if not (_is_plain(header_layout, header, 0) and _is_plain(transform_layout, transform, 0)):
        return False
    stamp = header_layout.get(header, 0)
    if not _is_plain(time_layout, stamp, 0):
        return False
    sec, nanosec = time_layout.get(stamp, 0), time_layout.get(stamp, 1)
    return (type(sec) is int and -0x80000000 <= sec < 0x80000000
            and type(nanosec) is int and 0 <= nanosec < NS_PER_S
            and type(header_layout.get(header, 1)) is str
            and type(transform_stamped_layout.get(message, 1)) is str
            and _is_plain(vector3_layout, transform_layout.get(transform, 0), 3)
            and _is_plain(quaternion_layout, transform_layout.get(transform, 1), 4))


cdef object new_time(int64_t time_ns):
    load()
    try:
        from rclpy.time import Time
    except ModuleNotFoundError:
        return _new_stamp(time_ns)
    return Time(nanoseconds=time_ns)


cdef object _new_stamp(int64_t stamp_ns):
    cdef int64_t sec = stamp_ns // NS_PER_S
    cdef int64_t nanosec = stamp_ns % NS_PER_S
    if nanosec < 0:         # C rounds towards zero
        sec -= 1
        nanosec += NS_PER_S
    stamp = time_layout.new()
    time_layout.put(stamp, 0, sec)
    time_layout.put(stamp, 1, nanosec)
    return stamp


cdef object new_header(int64_t stamp_ns, object frame_id):
    header = header_layout.new()
    header_layout.put(header, 0, _new_stamp(stamp_ns))
    header_layout.put(header, 1, frame_id)
    return header


cdef object new_transform_stamped(const Transform* transform, int64_t stamp_ns, object frame_id,
                                  object child_frame_id):
    load()
    inner = transform_layout.new()
    transform_layout.put(inner, 0, vector3_layout.new_doubles(transform.translation, 3))
    transform_layout.put(inner, 1, quaternion_layout.new_doubles(transform.rotation, 4))
    message = transform_stamped_layout.new()
    transform_stamped_layout.put(message, 0, new_header(stamp_ns, frame_id))
    transform_stamped_layout.put(message, 1, child_frame_id)
    transform_stamped_layout.put(message, 2, inner)
    return message
