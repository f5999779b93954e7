"""Owns how a frame name is shown in a line of a log."""

cdef enum:
    LOGGED_BYTES = 256      # of a name


cdef str name_for_log(const char* text, size_t size):
    if size <= LOGGED_BYTES:
        return text[:size].decode("utf-8")
    # The cut may split a character.
    return f"{text[:LOGGED_BYTES].decode('utf-8', 'ignore')}... ({size} bytes)"
