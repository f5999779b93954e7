"""Owns ending a forked child before the exit handlers of the middleware, which need threads of its parent."""

cdef extern from *:
    """
    #include <stdlib.h>
    /* C's atexit cannot do it: it does not tell the status to end with. Where the C library has nothing else,
       the handlers run. */
    #ifdef __GLIBC__
    #define tf2_on_exit on_exit
    #else
    #define tf2_on_exit(function, argument) 0
    #endif
    """
    int tf2_on_exit(void (*function)(int status, void* argument) noexcept, void* argument) nogil

cdef extern from "<stdio.h>" nogil:
    ctypedef struct FILE:
        pass
    int fflush(FILE* stream)

cdef extern from "<unistd.h>" nogil:
    void _exit(int status)


cdef void _end_now(int status, void* _) noexcept nogil:
    fflush(NULL)
    _exit(status)


def skip_exit_handlers():
    """End the process, when it exits, before the exit handlers of C and C++ that are registered by now."""
    if tf2_on_exit(_end_now, NULL) != 0:
        raise MemoryError
