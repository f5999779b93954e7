# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read and make messages of one class through the offsets of their slots."""

cdef enum:
    MAX_FIELDS = 9          # of a sensor_msgs/PointCloud2


cdef inline PyObject** slot_at(object message, Py_ssize_t offset):
    return <PyObject**>(<char*><PyObject*>message + offset)


@cython.final
cdef class Layout:
    # The offsets of the fields of one message class. message_layouts.pxi lists what this assumes of the
    # class; `by_slot` is True if that holds. Otherwise constructor and attributes are used.
    cdef readonly object message_class
    cdef readonly tuple fields                  # public names, in the order of the index arguments below
    cdef readonly bint by_slot
    cdef Py_ssize_t offsets[MAX_FIELDS]         # bytes from the object's start, by field
    cdef Py_ssize_t check_offset                # of the slot `_check_fields`, 0: there is none
    cdef object check_fields                    # what the ordinary constructor stores there

    cdef bint _find_slots(self) except -1
    # A message. All its fields must be set with `put` before any other code sees it.
    cdef object new(self)
    cdef object get(self, object message, int index)
    # The same as a borrowed reference if it can be read from its slot; otherwise NULL.
    cdef PyObject* peek(self, object message, int index) noexcept
    cdef inline int put(self, object message, int index, object value) except -1:
        if not self.by_slot:
            return self._put_attribute(message, index, value)
        Py_INCREF(value)
        slot_at(message, self.offsets[index])[0] = <PyObject*>value
        return 0

    cdef int _put_attribute(self, object message, int index, object value) except -1
    # The first `count` fields as doubles; TypeError if one is not a number.
    cdef int get_doubles(self, object message, double* out, int count) except -1
    cdef object new_doubles(self, const double* values, int count)
