"""A flag that a thread sets and others read without a lock: they see what was written before it, too."""

cdef extern from *:
    """
    #define TF2_FLAG_SET(flag, value) __atomic_store_n(flag, value, __ATOMIC_RELEASE)
    #define TF2_FLAG_IS_SET(flag) __atomic_load_n(flag, __ATOMIC_ACQUIRE)
    """
    void flag_set "TF2_FLAG_SET"(bint* flag, bint value) nogil
    bint flag_is_set "TF2_FLAG_IS_SET"(const bint* flag) nogil
