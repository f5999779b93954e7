"""Coordinates in any arrangement in memory, transformed into another frame."""

from tf2_py._internal cimport Transform


cdef struct Rigid:
    double matrix[9]        # row by row
    double translation[3]   # metres; zero for directions


cdef struct Triples:
    # Where x, y and z of each point lie; any alignment.
    Py_ssize_t offsets[3]   # bytes from the start of a point
    Py_ssize_t step         # bytes from one point's start to the next one's
    int numbers[3]          # what they are, see Number


# Of a rotation of any length, in the order in which tf2's NumPy computes it: whole numbers are cut off, and
# must be so at the same places. Translation zero where it does not move.
cdef void rigid_from_transform(const Transform* transform, bint moves, Rigid* out) noexcept nogil
# Both compute p' = R p + t for `count` points, in double precision. `source` and `target` may be the same if
# they are arranged alike. `bytes_after` is how many bytes after the last point's last coordinate may be read
# from `source` and written to `target`, unchanged; the bytes between points may be.
cdef void triples_transform(const char* source, const Triples* source_at, char* target,
                            const Triples* target_at, Py_ssize_t count, Py_ssize_t bytes_after,
                            const Rigid* rigid) noexcept nogil
# As many points, from the first on, as can be done quickly. `triples` tells how the target lies; the source
# lies alike, but its step may be another one where triples_fill_points: there all bytes of the target's
# points are written, and only there `target` need not be a copy of `source`.
cdef Py_ssize_t triples_transform_wide(const char* source, Py_ssize_t source_step, char* target,
                                       const Triples* triples, Py_ssize_t count, Py_ssize_t bytes_after,
                                       const Rigid* rigid) noexcept nogil
cdef bint triples_fill_points(const Triples* triples, Py_ssize_t source_step) noexcept nogil
