"""Owns what a process does not clean up at its exit: in a forked child, what needs threads of its parent."""

from cpython.ref cimport Py_INCREF

cdef extern from "<stdio.h>" nogil:
    ctypedef struct FILE:
        pass
    int fflush(FILE* stream)

cdef extern from "<stdlib.h>" nogil:
    int on_exit(void (*function)(int status, void* argument) noexcept, void* argument)

cdef extern from "<unistd.h>" nogil:
    void _exit(int status)


cdef void _end_now(int status, void* _) noexcept nogil:
    fflush(NULL)
    _exit(status)


def keep_for_ever(*things):
    """Never destroy these, not even at the interpreter's end."""
    for thing in things:
        Py_INCREF(thing)


def skip_exit_handlers():
    """End the process, when it exits, before the exit handlers of C and C++ that are registered by now."""
    if on_exit(_end_now, NULL) != 0:
        raise MemoryError
