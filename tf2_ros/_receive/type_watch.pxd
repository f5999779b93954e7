"""Whether an attribute of a type or of an object has changed, as the receive loop asks without the GIL."""

from tf2_py._internal cimport flag_is_set

cdef extern from "Python.h":
    ctypedef struct CPythonType "PyTypeObject":
        # Another one after every change of an attribute of the type or of one of its bases; 0: none.
        unsigned int tp_version_tag

cdef enum:
    MAX_TYPES = 2               # the listener's and the buffer's


cdef struct TypeWatch:
    CPythonType* types[MAX_TYPES]       # kept alive by whoever watches; NULL: none
    unsigned int versions[MAX_TYPES]    # when the watch began
    bint changed                        # a flag: an attribute of an object has changed, or the watch ran out
    bint spent                          # a type has no version, and the one permit for that was used


# Begins anew: nothing has changed.
cdef int type_watch_begin(TypeWatch* watch, list types) except -1


cdef inline bint type_watch_is_unchanged(const TypeWatch* watch) noexcept nogil:
    cdef size_t i
    for i in range(MAX_TYPES):
        if watch.types[i] != NULL and watch.types[i].tp_version_tag != watch.versions[i]:
            return False
    return not flag_is_set(&watch.changed)


# Whether a message may be taken on what was found when the watch began. A type whose attributes change very
# often gets no version: it is looked at again for each message.
cdef bint type_watch_permits(TypeWatch* watch) noexcept nogil
