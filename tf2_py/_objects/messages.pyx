"""Owns the traffic between messages of transforms and C structs."""

from cpython.float cimport PyFloat_CheckExact
from cpython.unicode cimport PyUnicode_Check
from libc.float cimport DBL_EPSILON
from libc.math cimport isfinite
from libc.stdint cimport int64_t
from libc.string cimport memchr

from tf2_py._core.geometry cimport quaternion_normalise
from tf2_py._core.stamp cimport NS_PER_S
from tf2_py._core.types cimport Incoming, Transform
from tf2_py._objects.layout cimport Layout
from tf2_py._objects.times cimport TIME_NANOSEC, TIME_SEC, load_time, nanoseconds, new_stamp, time_layout

from tf2_py._objects.errors import MalformedObjectError

cdef extern from "Python.h":
    const char* PyUnicode_AsUTF8AndSize(object text, Py_ssize_t* size) except NULL

# The fields of each class, in the order of its layout.
cdef enum:
    HEADER_STAMP = 0
    HEADER_FRAME_ID = 1
    TRANSFORM_TRANSLATION = 0
    TRANSFORM_ROTATION = 1
    STAMPED_HEADER = 0
    STAMPED_CHILD_FRAME_ID = 1
    STAMPED_TRANSFORM = 2

cdef Layout header_layout = None
cdef Layout vector3_layout = None
cdef Layout quaternion_layout = None
cdef Layout transform_layout = None
cdef Layout transform_stamped_layout = None


cdef int load() except -1:
    """Import the message packages, once, when the first message is read or made."""
    global header_layout, vector3_layout, quaternion_layout, transform_layout
    global transform_stamped_layout
    if transform_stamped_layout is not None:
        return 0
    from tf2_py._objects.message_classes import Header, Quaternion, Transform, TransformStamped, Vector3
    load_time()
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


cdef const char* authority_utf8(object authority, Py_ssize_t* size) except NULL:
    if not PyUnicode_Check(authority):
        raise TypeError(f"authority must be a str, not {type(authority).__name__}")
    return name_utf8(authority, size)


cdef int _read_transform(object transform, Transform* out) except -1:
    vector3_layout.get_doubles(transform_layout.get(transform, TRANSFORM_TRANSLATION), out.translation, 3)
    quaternion_layout.get_doubles(transform_layout.get(transform, TRANSFORM_ROTATION), out.rotation, 4)
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
            message = transform_stamped_layout.get(message, STAMPED_TRANSFORM)
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
        header = transform_stamped_layout.get(message, STAMPED_HEADER)
        child = transform_stamped_layout.get(message, STAMPED_CHILD_FRAME_ID)
        transform = transform_stamped_layout.get(message, STAMPED_TRANSFORM)
        parent = header_layout.get(header, HEADER_FRAME_ID)
        _read_transform(transform, &out.transform)
        out.stamp_ns = nanoseconds(header_layout.get(header, HEADER_STAMP), "header.stamp")
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


cdef inline bint _is_exact_class(Layout layout, object message, int count):
    # Whether it is of the class itself, not of a subclass, and its first `count` fields are floats.
    cdef int i
    if not layout.by_slot or type(message) is not layout.message_class:
        return False
    for i in range(count):
        if not PyFloat_CheckExact(layout.get(message, i)):
            return False
    return True


cdef bint is_exact_transform_stamped(object message) except -1:
    load()
    if not (_is_exact_class(transform_stamped_layout, message, 0)):
        return False
    header = transform_stamped_layout.get(message, STAMPED_HEADER)
    transform = transform_stamped_layout.get(message, STAMPED_TRANSFORM)
    if not (_is_exact_class(header_layout, header, 0) and _is_exact_class(transform_layout, transform, 0)):
        return False
    stamp = header_layout.get(header, HEADER_STAMP)
    if not _is_exact_class(time_layout, stamp, 0):
        return False
    sec, nanosec = time_layout.get(stamp, TIME_SEC), time_layout.get(stamp, TIME_NANOSEC)
    return (type(sec) is int and -0x80000000 <= sec < 0x80000000
            and type(nanosec) is int and 0 <= nanosec < NS_PER_S
            and type(header_layout.get(header, HEADER_FRAME_ID)) is str
            and type(transform_stamped_layout.get(message, STAMPED_CHILD_FRAME_ID)) is str
            and _is_exact_class(vector3_layout, transform_layout.get(transform, TRANSFORM_TRANSLATION), 3)
            and _is_exact_class(quaternion_layout, transform_layout.get(transform, TRANSFORM_ROTATION), 4))


cdef object new_header(int64_t stamp_ns, object frame_id):
    header = header_layout.new()
    header_layout.put(header, HEADER_STAMP, new_stamp(stamp_ns))
    header_layout.put(header, HEADER_FRAME_ID, frame_id)
    return header


cdef object new_transform_stamped(const Transform* transform, int64_t stamp_ns, object frame_id,
                                  object child_frame_id):
    load()
    inner = transform_layout.new()
    transform_layout.put(inner, TRANSFORM_TRANSLATION, vector3_layout.new_doubles(transform.translation, 3))
    transform_layout.put(inner, TRANSFORM_ROTATION, quaternion_layout.new_doubles(transform.rotation, 4))
    message = transform_stamped_layout.new()
    transform_stamped_layout.put(message, STAMPED_HEADER, new_header(stamp_ns, frame_id))
    transform_stamped_layout.put(message, STAMPED_CHILD_FRAME_ID, child_frame_id)
    transform_stamped_layout.put(message, STAMPED_TRANSFORM, inner)
    return message
