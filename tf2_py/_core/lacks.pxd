"""What a failed lookup lacks: the changes without which it fails again."""

from libc.stdint cimport int64_t, uint32_t

from tf2_py._core.lookup cimport Query
from tf2_py._core.tree cimport ChangeKind, Tree
from tf2_py._core.types cimport FrameId, Status


cdef struct Lack:
    ChangeKind kind
    FrameId frame           # but for CHANGE_NAME
    int64_t key             # a time in ns, NEWEST, ANY_TIME or the hash of a name; compared with a ChangeItem


cdef struct Lacks:
    Lack* items
    uint32_t count
    uint32_t capacity
    bint unknown            # any insert may help: for want of memory, or in a tree that once had a loop


# Zero a Lacks before its first use; its memory may be used again and again. Before the lookup has an answer
# one of the changes must come. They may come in vain: then what the lookup lacks must be found anew.
cdef void lacks_find(const Tree* tree, const Query* query, Status status, Lacks* lacks) noexcept nogil
cdef void lacks_free(Lacks* lacks) noexcept nogil
