"""Read and make messages of one class through the offsets of their slots."""

cdef enum:
    MAX_FIELDS = 9          # of a sensor_msgs/PointCloud2


cdef inline PyObject** slot_at(object message, Py_ssize_t offset):
    return <PyObject**>(<char*><PyObject*>message + offset)


@cython.final
cdef class Layout:
    # The offsets of the fields of one message class. messages.pyx lists what this assumes of the class;
    # `by_slot` is True if that holds. Otherwise constructor and attributes are used.
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


# ROS message objects and the structs of the engine, in both directions.

# Layouts of the classes below, None before load_layouts() has run.
cdef Layout header_layout, vector3_layout, quaternion_layout, transform_layout
cdef Layout transform_stamped_layout
cdef int load_layouts() except -1

# The UTF-8 of a name, owned by `name`. TypeError, which names the argument; UnicodeEncodeError (lone
# surrogate) or ValueError (NUL).
cdef const char* name_utf8(object name, Py_ssize_t* size, str argument=*) except NULL

# `keep` receives a reference to every object that `out` points into. If it is None, the caller must hold
# `message` and run no Python code while it uses `out`.
cdef int read_transform_stamped(object message, Incoming* out, list keep) except -1
# Whether all parts are exactly of rosidl's classes, with fields of the exact types, and a stamp whose
# nanoseconds are below a second. Only then does read_transform_stamped read everything in the message.
cdef bint is_exact_transform_stamped(object message) except -1
# A Transform, or the `transform` of a TransformStamped. As in tf2, a rotation whose squared length is below
# the epsilon of a double, and so also a zero one, means no rotation. ValueError if it is not finite.
cdef int read_transform(object message, Transform* out) except -1
cdef int read_any_rotation(object message, Transform* out) except -1   # the same, not normalised
cdef object new_header(int64_t stamp_ns, object frame_id)
cdef object new_transform_stamped(const Transform* transform, int64_t stamp_ns, object frame_id,
                                  object child_frame_id)
