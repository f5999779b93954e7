"""Messages of one class, read and made by the places of their slots."""

cimport cython
from cpython.object cimport PyObject

cdef enum:
    MAX_FIELDS = 9          # of a sensor_msgs/PointCloud2


@cython.final
cdef class Layout:
    # Where the fields of one message class lie. What is assumed of the class stands in layout.pyx; `by_slot`
    # tells that it holds. Where it is False everything goes through the constructor and attributes.
    cdef readonly object message_class
    cdef readonly tuple fields                  # public names, in the order of the index arguments below
    cdef readonly bint by_slot
    cdef Py_ssize_t offsets[MAX_FIELDS]         # bytes from the object's start, by field
    cdef Py_ssize_t check_offset                # of the slot `_check_fields`, 0: there is none
    cdef object check_fields                    # what the ordinary constructor stores there

    cdef bint _find_slots(self) except -1
    # A message whose fields must all be given with `put` before anyone else sees it.
    cdef object new(self)
    cdef object get(self, object message, int index)
    # The same, borrowed, where it can be read from its slot; otherwise NULL.
    cdef PyObject* peek(self, object message, int index) noexcept
    cdef int put(self, object message, int index, object value) except -1
    # The first `count` fields as doubles; TypeError where one is not a number.
    cdef int get_doubles(self, object message, double* out, int count) except -1
    cdef object new_doubles(self, const double* values, int count)
