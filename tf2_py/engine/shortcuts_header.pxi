"""Methods in Python with a shortcut in C for the usual arguments of a lookup."""

# Uses: no chapter.


@cython.final
cdef class Shortcut:
    # Stands for `function` in a class. A call with nothing but the frames and the time becomes a call of
    # `core`, a method of the same object, by name, so that overriding it has an effect.
    cdef void* vectorcall               # what CPython calls: see _make_callable
    cdef object function
    cdef object core
    cdef object default                 # of its `timeout`
    cdef bint is_pair                   # `core` returns a pair, and the method its first part, as a bool
    cdef object __weakref__
