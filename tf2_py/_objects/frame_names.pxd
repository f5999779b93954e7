"""Frame names as Python text."""

# For a line of a log: the name, UTF-8, or of a long one only the beginning, and its size in bytes.
cdef str name_for_log(const char* text, size_t size)
