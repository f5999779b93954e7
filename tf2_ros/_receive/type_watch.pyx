"""Owns noticing that a program replaces an attribute that decides who inserts transforms."""

from tf2_py._internal cimport flag_set


cdef int type_watch_begin(TypeWatch* watch, list types) except -1:
    cdef size_t i = 0
    if len(types) > MAX_TYPES:
        raise ValueError(f"{len(types)} types, at most {MAX_TYPES} are possible")
    flag_set(&watch.changed, False)
    watch.types[0] = watch.types[1] = NULL
    for one in types:
        getattr(one, "__init__", None)  # looking an attribute up gives a type its version
        watch.types[i] = <CPythonType*><void*>one
        watch.versions[i] = watch.types[i].tp_version_tag
        i += 1
    return 0


cdef bint type_watch_permits(TypeWatch* watch) noexcept nogil:
    cdef size_t i
    cdef bint has_versions = True
    if not type_watch_is_unchanged(watch):
        return False
    for i in range(MAX_TYPES):
        if watch.types[i] != NULL and watch.versions[i] == 0:
            has_versions = False
    if has_versions:
        return True
    if watch.spent:
        flag_set(&watch.changed, True)
        return False
    watch.spent = True
    return True
