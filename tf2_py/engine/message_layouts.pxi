# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Read and make messages of one class through the offsets of their slots.

rosidl's classes are slow to construct and to read through their properties. A Layout assumes the following of
a class, and checks it when it is made:

1. Its fields are slots: ``_x`` behind a property ``x``, or ``x`` itself. It has no other slots but
   ``_check_fields``, no ``__dict__`` and no ``__new__`` of its own.
2. CPython keeps a slot as one pointer to an object, at the offset in the class's member descriptor
   (``PyMemberDef.offset``); NULL means a deleted attribute.
3. A property returns the object of its slot. A message made in the ordinary way proves this.
4. The constructor stores the same ``_check_fields`` in every message, and nothing else besides the fields.

If one of these does not hold, ``by_slot`` is False: messages of the class are made with its constructor and
read and filled through their attributes, with the same results. Tested with the messages of ROS 2 Jazzy
(CPython 3.10 to 3.13) and Kilted (to 3.14); tests/core/test_message_slots.py has a test for each assumption.
"""

cdef extern from "Python.h":
    ctypedef struct PyMemberDef:
        int type
        Py_ssize_t offset
    ctypedef struct PyMemberDescrObject:
        PyMemberDef* d_member
    object PyType_GenericAlloc(PyTypeObject* cls, Py_ssize_t count)

cdef enum:
    SLOT_OBJECT = 16        # T_OBJECT_EX, what __slots__ makes


@cython.final
cdef class Layout:
    def __init__(self, message_class, tuple fields):
        self.message_class = message_class
        self.fields = fields
        self.by_slot = self._find_slots()
        if not self.by_slot:
            _SLOTS.report()

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
        # The proof: an ordinary message has the values of its attributes at these offsets.
        ordinary = cls()
        for i, name in enumerate(self.fields):
            value = getattr(ordinary, name)
            if slot_at(ordinary, self.offsets[i])[0] != <PyObject*>value:
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
            slot_at(message, self.check_offset)[0] = <PyObject*>self.check_fields
        return message

    cdef PyObject* peek(self, object message, int index) noexcept:
        if self.by_slot and type(message) is self.message_class:
            return slot_at(message, self.offsets[index])[0]
        return NULL

    cdef object get(self, object message, int index):
        cdef PyObject* value = self.peek(message, index)
        if value != NULL:
            return <object>value
        return getattr(message, self.fields[index])

    cdef int _put_attribute(self, object message, int index, object value) except -1:
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


def _has_slots():
    from tf2_py._objects.message_classes import TransformStamped
    return Layout(TransformStamped, ("header", "child_frame_id", "transform")).by_slot


# The table of this chapter, see tf2_py._objects.assumptions.
_SLOTS = Assumption("the slots of messages", _has_slots, "lookups and inserts take longer")


cdef Py_ssize_t _slot_offset(cls, str name):
    # -1 if the attribute is not a slot that holds an object.
    cdef PyMemberDef* member
    descriptor = getattr(cls, name, None)
    if type(descriptor) is not types.MemberDescriptorType:
        return -1
    member = (<PyMemberDescrObject*>descriptor).d_member
    return member.offset if member.type == SLOT_OBJECT else -1
