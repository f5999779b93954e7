"""Owns the parts that geometry messages share: reading them into C doubles, and making new ones."""

from cpython.float cimport PyFloat_AS_DOUBLE, PyFloat_CheckExact
from cpython.object cimport PyObject
from cpython.unicode cimport PyUnicode_Check
from libc.math cimport NAN
from libc.string cimport memcpy

cimport numpy as cnp

from tf2_py._internal cimport (
    Layout,
    Transform,
    header_layout,
    load,
    nanoseconds,
    new_header,
    quaternion_normalise_any,
    transform_stamped_layout,
)

import numpy as np
from geometry_msgs.msg import Point, Point32, Pose, Quaternion, Vector3

from tf2_py._internal import MalformedObjectError

cdef extern from "Python.h":
    # Without counting references.
    Py_ssize_t PyTuple_GET_SIZE(PyObject* items)
    PyObject* PyTuple_GET_ITEM(PyObject* items, Py_ssize_t index)

cdef enum:
    MAX_COVARIANCE = 36     # numbers, of a pose or a twist

cnp.import_array()
load()

cdef Layout point_layout = Layout(Point, ("x", "y", "z"))
cdef Layout point32_layout = Layout(Point32, ("x", "y", "z"))
cdef Layout vector3_layout = Layout(Vector3, ("x", "y", "z"))
cdef Layout quaternion_layout = Layout(Quaternion, ("x", "y", "z", "w"))
cdef Layout pose_layout = Layout(Pose, ("position", "orientation"))


cdef _type_error(Layout layout, object message, Exception reason):
    kind = MalformedObjectError if isinstance(reason, AttributeError) else TypeError
    cls = layout.message_class
    name = f"{cls.__module__.partition('.')[0]}/{cls.__name__}"
    got = type(message).__name__
    return kind(f"expected a {name} or an object with its fields, got {got}: {reason}")


cdef int _index_of(Layout layout, str name) except -1:
    # Python interns the names in all modules, so that nearly always the same name is the same object.
    cdef PyObject* fields = <PyObject*>layout.fields
    cdef Py_ssize_t i
    for i in range(PyTuple_GET_SIZE(fields)):
        if PyTuple_GET_ITEM(fields, i) == <PyObject*>name:
            return i
    if name not in layout.fields:
        raise LookupError(f"the layout of {layout.message_class.__name__} has no field {name!r}")
    return layout.fields.index(name)


cdef object get_field(Layout layout, object message, str name):
    cdef PyObject* value = layout.peek(message, _index_of(layout, name))
    return <object>value if value != NULL else _get_attribute(layout, message, name)


cdef object _get_attribute(Layout layout, object message, str name):
    try:
        return getattr(message, name)
    except AttributeError as missing:
        raise _type_error(layout, message, missing) from None


cdef int set_field(Layout layout, object message, str name, object value) except -1:
    return layout.put(message, _index_of(layout, name), value)


cdef int read_doubles(Layout layout, object message, double* out, int count) except -1:
    cdef PyObject* value
    cdef int i
    for i in range(count):
        value = layout.peek(message, i)
        if value == NULL or not PyFloat_CheckExact(<object>value):
            return _read_numbers(layout, message, out, count)
        out[i] = PyFloat_AS_DOUBLE(<object>value)
    return 0


cdef int _read_numbers(Layout layout, object message, double* out, int count) except -1:
    try:
        return layout.get_doubles(message, out, count)
    except (AttributeError, TypeError) as missing:
        raise _type_error(layout, message, missing) from None


cdef int read_orientation(object quaternion, double* out) except -1:
    read_doubles(quaternion_layout, quaternion, out, 4)
    if out[0] == 0.0 and out[1] == 0.0 and out[2] == 0.0 and out[3] == 0.0:
        out[3] = 1.0
    elif not quaternion_normalise_any(out):
        out[0] = out[1] = out[2] = out[3] = NAN
    return 0


cdef int read_pose(object pose, Transform* out) except -1:
    read_doubles(point_layout, get_field(pose_layout, pose, "position"), out.translation, 3)
    return read_orientation(get_field(pose_layout, pose, "orientation"), out.rotation)


cdef int read_covariance(object covariance, int side, double* out) except -1:
    cdef cnp.ndarray values
    cdef int count = side * side
    if not cnp.PyArray_CheckExact(covariance) or not _is_contiguous_doubles(covariance):
        try:
            covariance = np.asarray(covariance, dtype=np.float64, order="C")
        except (TypeError, ValueError) as reason:
            raise TypeError(f"a covariance must be {count} numbers: {reason}") from None
    values = covariance
    if cnp.PyArray_NDIM(values) == 0:
        raise TypeError(f"a covariance must be {count} numbers, not one value")
    if cnp.PyArray_SIZE(values) != count:
        raise ValueError(f"a covariance must be {count} numbers, got {cnp.PyArray_SIZE(values)}")
    memcpy(out, cnp.PyArray_DATA(values), count * sizeof(double))
    return 0


cdef bint _is_contiguous_doubles(cnp.ndarray values):
    return cnp.PyArray_TYPE(values) == cnp.NPY_DOUBLE and cnp.PyArray_ISCARRAY_RO(values)


cdef object copy_shallow(Layout layout, object message):
    cdef PyObject* value
    cdef int i
    copy = layout.new()
    for i, name in enumerate(layout.fields):
        value = layout.peek(message, i)
        layout.put(copy, i, <object>value if value != NULL else _get_attribute(layout, message, name))
    return copy


cdef object _frame_id_of(object header):
    frame_id = get_field(header_layout, header, "frame_id")
    if not PyUnicode_Check(frame_id):
        raise TypeError(f"a frame_id must be a str, not {type(frame_id).__name__}")
    return frame_id


cdef object target_frame(object transform):
    return _frame_id_of(get_field(transform_stamped_layout, transform, "header"))


cdef object target_header(object transform):
    header = get_field(transform_stamped_layout, transform, "header")
    stamp_ns = nanoseconds(get_field(header_layout, header, "stamp"), "header.stamp")
    return new_header(stamp_ns, _frame_id_of(header))


cdef object new_orientation(const double* q):
    cdef double negated[4]
    if q[3] >= 0.0:
        return quaternion_layout.new_doubles(q, 4)
    negated[0] = -q[0]
    negated[1] = -q[1]
    negated[2] = -q[2]
    negated[3] = -q[3]
    return quaternion_layout.new_doubles(negated, 4)


cdef object new_pose(const Transform* pose):
    message = pose_layout.new()
    set_field(pose_layout, message, "position", point_layout.new_doubles(pose.translation, 3))
    set_field(pose_layout, message, "orientation", new_orientation(pose.rotation))
    return message


cdef object new_covariance(const double* values, int side):
    cdef cnp.npy_intp count = side * side
    array = cnp.PyArray_SimpleNew(1, &count, cnp.NPY_DOUBLE)
    memcpy(cnp.PyArray_DATA(array), values, count * sizeof(double))
    return array


cdef object copied_covariance(object covariance, int side):
    cdef double values[MAX_COVARIANCE]
    read_covariance(covariance, side, values)
    return new_covariance(values, side)
