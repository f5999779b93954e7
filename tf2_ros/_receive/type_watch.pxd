"""Whether an attribute of a type or of an object has changed, as the receive loop asks without the GIL."""

from tf2_py._internal cimport flag_is_set, flag_set

cdef extern from "Python.h":
    ctypedef struct CPythonType "PyTypeObject":
        # Another one after every change of an attribute of the type or of one of its bases; 0: none.
        unsigned int tp_version_tag

cdef enum:
    MAX_TYPES = 2               # the listener's and the buffer's


cdef struct TypeWatch:
    CPythonType* types[MAX_TYPES]       # kept alive by whoever watches; NULL: none
    unsigned int versions[MAX_TYPES]    # when the watch began
    bint has_versions                   # otherwise a change of a type cannot be seen
    bint changed                        # a flag: an attribute of an object has changed, or the watch ran out
    bint ran_out                        # without versions: a message was taken, or waited for, since it began


# Begins anew: nothing has changed.
cdef int type_watch_begin(TypeWatch* watch, list types) except -1


cdef inline bint type_watch_is_unchanged(const TypeWatch* watch) noexcept nogil:
    cdef size_t i
    for i in range(MAX_TYPES):
        if watch.types[i] != NULL and watch.types[i].tp_version_tag != watch.versions[i]:
            return False
    return not flag_is_set(&watch.changed)


# Whether a message may be taken on what was found when the watch began. Python gives no version to a type
# whose attributes change very often: there, what was found holds for one message, and only for one that is
# there already. A change in the moment between the two is then seen one message later.
cdef inline bint type_watch_permits(TypeWatch* watch) noexcept nogil:
    if watch.ran_out:
        flag_set(&watch.changed, True)
    return type_watch_is_unchanged(watch)


# A message was taken, or is waited for.
cdef inline void type_watch_goes_on(TypeWatch* watch) noexcept nogil:
    watch.ran_out = not watch.has_versions
