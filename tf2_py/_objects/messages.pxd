"""ROS message objects and the structs of the engine, in both directions."""

cimport cython
from cpython.object cimport PyObject
from libc.stdint cimport int64_t

from tf2_py._core.types cimport Incoming, Transform

cdef enum:
    MAX_FIELDS = 9          # of a sensor_msgs/PointCloud2


@cython.final
cdef class Layout:
    # Where the fields of one message class lie. rosidl's classes are slow to construct and to read through
    # their properties; their slots are plain pointers at fixed offsets. `by_slot` says that a message made
    # the ordinary way was found to look just so; where it is False everything goes through attributes.
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


# Layouts of the classes below, None before load() has run.
cdef Layout time_layout, header_layout, vector3_layout, quaternion_layout, transform_layout
cdef Layout transform_stamped_layout
cdef int load() except -1

# The UTF-8 of a name, owned by `name`. TypeError, UnicodeEncodeError (lone surrogate) or ValueError (NUL).
cdef const char* name_utf8(object name, Py_ssize_t* size) except NULL
# Nanoseconds of a time or duration: anything with `nanoseconds`, or with `sec` and `nanosec`.
cdef int64_t time_to_ns(object time) except? -1
cdef int64_t duration_to_ns(object duration) except? -1

# `keep`, where not None, is given a reference to every object that `out` points into; where it is None
# the caller holds `message` and runs no Python code while it uses `out`.
cdef int read_transform_stamped(object message, Incoming* out, list keep) except -1
# Whether the message is just what its class makes: real rosidl messages down to the numbers, with a stamp
# whose nanoseconds are below a second. Only then is what read_transform_stamped reads all that there is.
cdef bint is_plain_transform_stamped(object message) except -1
# A Transform, or the `transform` of a TransformStamped. As in tf2, a rotation whose squared length is below a
# double's epsilon, so also a zero one, counts as none. ValueError where it is not finite.
cdef int read_transform(object message, Transform* out) except -1
cdef int read_any_rotation(object message, Transform* out) except -1   # the same, not normalised
cdef object new_time(int64_t time_ns)      # an rclpy.time.Time, or a stand-in without rclpy
cdef object new_header(int64_t stamp_ns, object frame_id)
cdef object new_transform_stamped(const Transform* transform, int64_t stamp_ns, object frame_id,
                                  object child_frame_id)
