"""Why a lookup has no answer: as an exception, and as a sentence about a wait."""

from tf2_py._core.lookup cimport Query
from tf2_py._core.types cimport Status
from tf2_py._objects.advice cimport Advice

# The only function that makes an exception of a status; the names are those of status.child and
# status.parent. `advice` was begun with `buffer`.
cdef object query_error(const Query* query, Status status, str child, str parent, str call, Advice advice,
                        object buffer)
# What a wait for the lookup waits for, and what it lacks; `child` is the name of status.child, `list_names`
# gives all names.
cdef str query_lack(const Query* query, Status status, str child, Advice advice, object list_names)
