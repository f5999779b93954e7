"""Owns what Python code asks about a frame name: whether it is invalid, and how a line of a log shows it."""

from tf2_py._core.names cimport name_is_invalid

cdef enum:
    LOGGED_BYTES = 256      # of a name


def is_invalid_name(name):
    """Whether no lookup ever accepts this name, a str: it is empty, or begins with a ``/``."""
    cdef bytes utf8 = name.encode("utf-8", "surrogatepass")
    return name_is_invalid(utf8, len(utf8))


cdef str name_for_log(const char* text, size_t size):
    if size <= LOGGED_BYTES:
        return text[:size].decode("utf-8")
    # The cut may split a character.
    return f"{text[:LOGGED_BYTES].decode('utf-8', 'ignore')}... ({size} bytes)"
