"""Coordinates that lie in memory in any arrangement, carried into another frame."""

from tf2_py._types cimport Transform


cdef enum Number:
    FLOAT32
    FLOAT64
    FLOAT32_SWAPPED     # of the other byte order than this machine's
    FLOAT64_SWAPPED


cdef struct Rigid:
    double matrix[9]        # row by row
    double translation[3]   # metres; zero for directions


cdef struct Triples:
    # Where x, y and z of each point lie; any alignment.
    Py_ssize_t offsets[3]   # bytes from the start of a point
    Py_ssize_t step         # bytes from one point's start to the next one's
    Number number           # what they are


cdef void rigid_from_transform(const Transform* transform, bint moves, Rigid* out) noexcept nogil
# Both carry p' = R p + t for `count` points, in double precision. `source` and `target` may be the same if
# they lie alike. `behind` is how many bytes after the last point's last coordinate may be read from `source`
# and written to `target`, unchanged; the bytes between points may be.
cdef void triples_carry(const char* source, const Triples* here, char* target, const Triples* there,
                        Py_ssize_t count, Py_ssize_t behind, const Rigid* rigid) noexcept nogil
# As many points, from the first on, as can be done quickly; where triples_fill_points, all their bytes are
# written.
cdef Py_ssize_t triples_carry_wide(const char* source, char* target, const Triples* triples,
                                   Py_ssize_t count, Py_ssize_t behind, const Rigid* rigid) noexcept nogil
cdef bint triples_fill_points(const Triples* triples) noexcept nogil
