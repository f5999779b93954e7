"""What a failed lookup lacks: changes without one of which it fails again."""

from libc.stdint cimport int64_t, uint32_t

from tf2_py._core.change cimport ChangeKind
from tf2_py._core.lookup cimport Query
from tf2_py._core.tree cimport Tree
from tf2_py._core.types cimport FrameId, Status


cdef struct Lack:
    # One change that could help.
    ChangeKind kind
    FrameId frame           # NO_FRAME for CHANGE_NAME
    int64_t key             # a time in ns, NEWEST, ANY_TIME or the hash of a name; compared with a ChangeItem


cdef struct Lacks:
    Lack* items             # any one of them may help
    uint32_t count          # items in use
    uint32_t capacity       # items allocated
    bint unknown            # any insert may help: there was no memory, or the tree once had a loop


# Zero a Lacks before its first use; it may be filled again. `status`: with which the lookup has failed, under
# the same hold of the tree's lock. Before the lookup has an answer one of the changes must happen. That may
# not be enough: then what the lookup lacks must be found again.
cdef void lacks_find(const Tree* tree, const Query* query, Status status, Lacks* lacks) noexcept nogil
cdef void lacks_free(Lacks* lacks) noexcept nogil
