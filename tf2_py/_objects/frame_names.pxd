"""Frame names in lines of a log."""

# A name, UTF-8: of a long one only the beginning, and its size in bytes.
cdef str name_for_log(const char* text, size_t size)
