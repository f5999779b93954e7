# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Make messages of transforms, and use those again that nobody has kept.

Most programs read an answer and drop it. Making and freeing its six objects would take half of the time of a
lookup. So the last messages remain here, and a new answer goes into one of them, as CPython does with the
tuples of ``zip``, if

1. nothing else refers to the message or to any of its parts, so that nobody can see it change. Whoever looks
   at one holds a reference: variables, coroutines, CPython's stack, ``gc.get_objects``, a call that publishes
   it. There are no weak references to these classes, which have no slot for them (``by_slot``).
2. it is what this chapter made: each part is exactly of its class, and its slots hold such parts and plain
   numbers and names. So replacing these runs no Python code, and a program that has deleted, replaced or
   added something leaves nothing of it in an answer.
3. the classes have no finalizers, which would be expected to run for each message.

Slots change, and floats to which only their slot refers; never a number that anybody else has. From the check
to the return, nothing runs Python code, nor releases the GIL, nor allocates what the garbage collector knows,
so no other thread, signal handler or finalizer comes between. If memory is short, the message is freed.

Without the GIL, this would not be enough, and every message is a new one.
"""

cdef extern from *:
    """
    #ifdef Py_GIL_DISABLED
    #define TF2_KEEPS_MESSAGES 0
    #else
    #define TF2_KEEPS_MESSAGES 1
    #endif
    #if PY_VERSION_HEX >= 0x030E0000
    #define TF2_IS_ONLY_REFERENCE(object) PyUnstable_Object_IsUniquelyReferenced(object)
    #else
    #define TF2_IS_ONLY_REFERENCE(object) (Py_REFCNT(object) == 1)
    #endif
    """
    const bint KEEPS_MESSAGES "TF2_KEEPS_MESSAGES"
    bint is_only_reference "TF2_IS_ONLY_REFERENCE"(PyObject* object) noexcept
    PyTypeObject* type_of "Py_TYPE"(PyObject* object) noexcept
    PyObject* new_float "PyFloat_FromDouble"(double value) except NULL
    PyObject* new_int "PyLong_FromLongLong"(long long value) except NULL
    ctypedef struct PyFloatObject:
        double ob_fval
    PyTypeObject FLOAT "PyFloat_Type"
    PyTypeObject INT "PyLong_Type"
    PyTypeObject STR "PyUnicode_Type"

cdef enum:
    KEPT = 8    # so that a program may hold the last seven

# One set for the process: no second interpreter can import this module.
cdef PyObject* _kept[KEPT]
cdef unsigned int _turn = 0
cdef bint _is_keeping = False
cdef bint _is_begun = False


cdef struct Shape:
    # A Layout in C, because passing a global object counts a reference to it each time.
    PyTypeObject* cls
    const Py_ssize_t* offsets
    Py_ssize_t check_offset
    PyObject* check_fields

cdef Shape _stamped_shape, _header_shape, _stamp_shape
cdef Shape _transform_shape, _translation_shape, _rotation_shape

cdef struct Parts:
    PyObject* message
    PyObject* header
    PyObject* stamp
    PyObject* transform
    PyObject* translation
    PyObject* rotation


cdef inline PyObject** _slot(const Shape* shape, PyObject* part, int index) noexcept:
    return slot_at(<object>part, shape.offsets[index])


cdef inline bint _is_reusable(const Shape* shape, PyObject* part) noexcept:
    # Apart from its fields. A deleted one is NULL.
    return (part != NULL
            and is_only_reference(part)
            and type_of(part) == shape.cls
            and shape.cls.tp_finalize == NULL
            and (not shape.check_offset
                 or slot_at(<object>part, shape.check_offset)[0] == shape.check_fields))


cdef inline bint _are(PyTypeObject* cls, const Shape* shape, PyObject* part, int first, int end) noexcept:
    cdef int i
    cdef PyObject* value
    for i in range(first, end):
        value = _slot(shape, part, i)[0]
        if value == NULL or type_of(value) != cls:
            return False
    return True


cdef bint _find_parts(PyObject* message, Parts* parts) noexcept:
    # Whether the message can be used again; then, its parts.
    if not _is_reusable(&_stamped_shape, message):
        return False
    parts.message = message
    parts.header = _slot(&_stamped_shape, message, STAMPED_HEADER)[0]
    parts.transform = _slot(&_stamped_shape, message, STAMPED_TRANSFORM)[0]
    if not (_is_reusable(&_header_shape, parts.header) and _is_reusable(&_transform_shape, parts.transform)):
        return False
    parts.stamp = _slot(&_header_shape, parts.header, HEADER_STAMP)[0]
    parts.translation = _slot(&_transform_shape, parts.transform, TRANSFORM_TRANSLATION)[0]
    parts.rotation = _slot(&_transform_shape, parts.transform, TRANSFORM_ROTATION)[0]
    return (_is_reusable(&_stamp_shape, parts.stamp)
            and _is_reusable(&_translation_shape, parts.translation)
            and _is_reusable(&_rotation_shape, parts.rotation)
            and _are(&FLOAT, &_translation_shape, parts.translation, 0, 3)
            and _are(&FLOAT, &_rotation_shape, parts.rotation, 0, 4)
            and _are(&INT, &_stamp_shape, parts.stamp, TIME_SEC, TIME_NANOSEC + 1)
            and _are(&STR, &_header_shape, parts.header, HEADER_FRAME_ID, HEADER_FRAME_ID + 1)
            and _are(&STR, &_stamped_shape, message, STAMPED_CHILD_FRAME_ID, STAMPED_CHILD_FRAME_ID + 1))


cdef inline void _replace(PyObject** slot, PyObject* value) noexcept:
    # The slot receives the reference to the value.
    cdef PyObject* old = slot[0]
    slot[0] = value
    Py_DECREF(<object>old)


cdef inline int _put_float(PyObject** slot, double value) except -1:
    if is_only_reference(slot[0]):
        (<PyFloatObject*>slot[0]).ob_fval = value
    else:
        _replace(slot, new_float(value))
    return 0


cdef int _fill(const Parts* parts, const Transform* transform, int64_t stamp_ns, object frame_id,
               object child_frame_id) except -1:
    cdef int i
    cdef int64_t sec
    cdef uint32_t nanosec
    for i in range(3):
        _put_float(_slot(&_translation_shape, parts.translation, i), transform.translation[i])
    for i in range(4):
        _put_float(_slot(&_rotation_shape, parts.rotation, i), transform.rotation[i])
    stamp_split(stamp_ns, &sec, &nanosec)
    _replace(_slot(&_stamp_shape, parts.stamp, TIME_SEC), new_int(sec))
    _replace(_slot(&_stamp_shape, parts.stamp, TIME_NANOSEC), new_int(nanosec))
    Py_INCREF(frame_id)
    _replace(_slot(&_header_shape, parts.header, HEADER_FRAME_ID), <PyObject*>frame_id)
    Py_INCREF(child_frame_id)
    _replace(_slot(&_stamped_shape, parts.message, STAMPED_CHILD_FRAME_ID), <PyObject*>child_frame_id)
    return 0


cdef object _make(const Transform* transform, int64_t stamp_ns, object frame_id, object child_frame_id):
    inner = transform_layout.new()
    transform_layout.put(inner, TRANSFORM_TRANSLATION, vector3_layout.new_doubles(transform.translation, 3))
    transform_layout.put(inner, TRANSFORM_ROTATION, quaternion_layout.new_doubles(transform.rotation, 4))
    message = transform_stamped_layout.new()
    transform_stamped_layout.put(message, STAMPED_HEADER, new_header(stamp_ns, frame_id))
    transform_stamped_layout.put(message, STAMPED_CHILD_FRAME_ID, child_frame_id)
    transform_stamped_layout.put(message, STAMPED_TRANSFORM, inner)
    return message


def _keep_no_more():
    """Let the kept messages go, and keep no others: the interpreter ends."""
    global _is_keeping
    cdef PyObject* message
    cdef int i
    _is_keeping = False
    for i in range(KEPT):
        message = _kept[i]
        _kept[i] = NULL
        Py_XDECREF(message)


cdef Shape _shape_of(Layout layout) noexcept:
    # The layouts are never destroyed.
    cdef Shape shape
    shape.cls = <PyTypeObject*>layout.message_class
    shape.offsets = layout.offsets
    shape.check_offset, shape.check_fields = layout.check_offset, <PyObject*>layout.check_fields
    return shape


cdef int _begin() except -1:
    global _is_begun, _is_keeping
    global _stamped_shape, _header_shape, _stamp_shape
    global _transform_shape, _translation_shape, _rotation_shape
    load_layouts()
    layouts = (transform_stamped_layout, header_layout, time_layout, transform_layout, vector3_layout,
               quaternion_layout)
    if KEEPS_MESSAGES and all([(<Layout>layout).by_slot for layout in layouts]):
        _stamped_shape, _header_shape = _shape_of(transform_stamped_layout), _shape_of(header_layout)
        _stamp_shape, _transform_shape = _shape_of(time_layout), _shape_of(transform_layout)
        _translation_shape, _rotation_shape = _shape_of(vector3_layout), _shape_of(quaternion_layout)
        import atexit
        atexit.register(_keep_no_more)
        _is_keeping = True
    _is_begun = True
    return 0


cdef object new_transform_stamped(const Transform* transform, int64_t stamp_ns, object frame_id,
                                  object child_frame_id):
    global _turn
    cdef Parts parts
    cdef PyObject** place
    cdef PyObject* oldest
    if not _is_begun:
        _begin()
    if not _is_keeping:
        return _make(transform, stamp_ns, frame_id, child_frame_id)
    _turn = (_turn + 1) % KEPT
    place = &_kept[_turn]
    if _find_parts(place[0], &parts):
        # The reference is now that of `message`, which is freed if this raises.
        place[0] = NULL
        message = <object>parts.message
        Py_DECREF(message)
        _fill(&parts, transform, stamp_ns, frame_id, child_frame_id)
    else:
        # This may run finalizers, which may look up.
        message = _make(transform, stamp_ns, frame_id, child_frame_id)
    Py_INCREF(message)
    oldest = place[0]
    place[0] = <PyObject*>message
    Py_XDECREF(oldest)
    return message
