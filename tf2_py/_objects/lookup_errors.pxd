"""Why a lookup has no answer, as an exception."""

from tf2_py._core.lookup cimport Query
from tf2_py._core.types cimport Status

# The one place that turns a status into an exception; the names are those of status.child and status.parent.
cdef object query_error(const Query* query, Status status, str child, str parent, str call)
