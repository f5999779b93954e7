"""Owns noticing that a program replaces an attribute that decides who inserts transforms."""

from tf2_py._internal cimport flag_set


cdef int type_watch_begin(TypeWatch* watch, list types) except -1:
    cdef size_t i = 0
    if len(types) > MAX_TYPES:
        raise ValueError(f"{len(types)} types, at most {MAX_TYPES} are possible")
    flag_set(&watch.changed, False)
    watch.types[0] = watch.types[1] = NULL
    watch.has_versions = True
    watch.ran_out = False
    for one in types:
        getattr(one, "__init__", None)  # looking an attribute up gives a type its version
        watch.types[i] = <CPythonType*><void*>one
        watch.versions[i] = watch.types[i].tp_version_tag
        watch.has_versions = watch.has_versions and watch.versions[i] != 0
        i += 1
    return 0
