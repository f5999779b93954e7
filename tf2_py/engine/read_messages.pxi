# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read messages of transforms into C structs, and make headers."""

cdef extern from "Python.h":
    const char* PyUnicode_AsUTF8AndSize(object text, Py_ssize_t* size) except NULL

cdef enum:
    LOGGED_BYTES = 256      # of a name

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


cdef int load_layouts() except -1:
    """Import the message packages, once, when the first message is read or made."""
    global header_layout, vector3_layout, quaternion_layout, transform_layout
    global transform_stamped_layout
    if transform_stamped_layout is not None:
        return 0
    from tf2_py._objects.message_classes import Header, Quaternion, Transform, TransformStamped, Vector3
    load_time()
    header = Layout(Header, ("stamp", "frame_id"))
    vector3 = Layout(Vector3, ("x", "y", "z"))
    quaternion = Layout(Quaternion, ("x", "y", "z", "w"))
    transform = Layout(Transform, ("translation", "rotation"))
    stamped = Layout(TransformStamped, ("header", "child_frame_id", "transform"))
    # Other threads may have loaded them meanwhile, and use them. From here on, no code in Python runs.
    if transform_stamped_layout is None:
        header_layout, vector3_layout, quaternion_layout = header, vector3, quaternion
        transform_layout, transform_stamped_layout = transform, stamped
    return 0


cdef const char* _utf8(object name, Py_ssize_t* size, str argument) except NULL:
    if not PyUnicode_Check(name):
        raise TypeError(f"{argument}: expected a str, got {type(name).__name__}")
    return PyUnicode_AsUTF8AndSize(name, size)


cdef const char* name_utf8(object name, Py_ssize_t* size, str argument="frame name") except NULL:
    cdef const char* text = _utf8(name, size, argument)
    if memchr(text, 0, size[0]) != NULL:
        raise ValueError(f"a frame name must not contain a NUL character: {name!r}")
    return text


cdef const char* authority_utf8(object authority, Py_ssize_t* size) except NULL:
    if authority is None:
        raise TypeError("authority is missing: pass the name of the publisher, a str")
    return name_utf8(authority, size, "authority")


cdef str name_for_log(const char* text, size_t size):
    if size <= LOGGED_BYTES:
        return text[:size].decode("utf-8")
    # The cut may split a character.
    return f"{text[:LOGGED_BYTES].decode('utf-8', 'ignore')}... ({size} bytes)"


cdef int _read_transform(object transform, Transform* out) except -1:
    vector3_layout.get_doubles(transform_layout.get(transform, TRANSFORM_TRANSLATION), out.translation, 3)
    quaternion_layout.get_doubles(transform_layout.get(transform, TRANSFORM_ROTATION), out.rotation, 4)
    return 0


cdef _misfit(object message, str wanted, object missing, str advice=""):
    given = f"the class {message.__name__}" if isinstance(message, type) else type(message).__name__
    return MalformedObjectError(
        f"expected {wanted} or an object with its fields, got {given}: {missing}{advice}"
    )


cdef int read_any_rotation(object message, Transform* out) except -1:
    cdef double squared
    cdef double* q = out.rotation
    transform = message
    load_layouts()
    try:
        if type(message) is transform_stamped_layout.message_class:
            transform = transform_stamped_layout.get(message, STAMPED_TRANSFORM)
        elif hasattr(message, "transform"):
            transform = message.transform
        _read_transform(transform, out)
    except AttributeError as missing:
        wanted = "a geometry_msgs/TransformStamped, a Transform,"
        raise _misfit(message, wanted, missing, "; pass the message first, then the transform") from None
    squared = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    if not isfinite(squared):
        raise ValueError(
            f"transform.rotation: expected a quaternion of finite length, got {(q[0], q[1], q[2], q[3])}"
        )
    if squared < DBL_EPSILON:
        q[0] = q[1] = q[2] = 0.0
        q[3] = 1.0
    return 0


cdef int read_transform(object message, Transform* out) except -1:
    read_any_rotation(message, out)
    quaternion_normalize(out.rotation)
    return 0


cdef int read_transform_stamped(object message, Incoming* out, list keep) except -1:
    cdef Py_ssize_t size
    load_layouts()
    try:
        header = transform_stamped_layout.get(message, STAMPED_HEADER)
        child = transform_stamped_layout.get(message, STAMPED_CHILD_FRAME_ID)
        transform = transform_stamped_layout.get(message, STAMPED_TRANSFORM)
        parent = header_layout.get(header, HEADER_FRAME_ID)
        _read_transform(transform, &out.transform)
        out.stamp_ns = nanoseconds(header_layout.get(header, HEADER_STAMP), "header.stamp")
    except AttributeError as missing:
        are_several = hasattr(message, "__iter__") or hasattr(message, "transforms")
        advice = "; set_transforms takes a list of transforms" if are_several else ""
        raise _misfit(message, "a geometry_msgs/TransformStamped", missing, advice) from None
    # This comes last, so that no Python code runs between taking these pointers and using them. The names end
    # at a NUL, as they do if the message is sent.
    out.parent = _utf8(parent, &size, "header.frame_id")
    out.parent_size = strlen(out.parent)
    out.child = _utf8(child, &size, "child_frame_id")
    out.child_size = strlen(out.child)
    if keep is not None:
        keep.append(parent)
        keep.append(child)
    return 0


cdef object new_header(int64_t stamp_ns, object frame_id):
    header = header_layout.new()
    header_layout.put(header, HEADER_STAMP, new_stamp(stamp_ns))
    header_layout.put(header, HEADER_FRAME_ID, frame_id)
    return header
