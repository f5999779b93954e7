"""A whole tree as flat arrays, for what outlives the process: all that answers and listings depend on."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t, uint64_t

from tf2_py._core.lock cimport Lock
from tf2_py._core.tree cimport Limits, Tree
from tf2_py._core.types cimport REFUSAL_KINDS


cdef struct FrameRow:
    # What is told of one frame beside its samples; see Cache.
    uint32_t kind               # a CacheKind
    uint32_t count
    uint32_t authority
    uint32_t is_parent          # 0 or 1
    # So that the limit of bytes refuses the same transforms as before.
    uint32_t capacity
    uint32_t mostly_empty_for


cdef enum:
    FRAME_ROW_COLUMNS = 6       # uint32_t each


cdef struct TreeArrays:
    # The arrays belong to the caller. Names are UTF-8, each followed by a NUL. A frame's id is its place
    # among the names, from 1; an authority's likewise. The samples of all frames follow one another in the
    # order of the frames, oldest first.
    const char* names
    size_t names_size           # bytes
    const char* authorities
    size_t authorities_size     # bytes
    FrameRow* frames
    uint32_t frame_count
    int64_t* stamps
    double* transforms          # TRANSFORM_DOUBLES per sample
    uint32_t* parents           # ids
    uint64_t sample_count
    int64_t cache_time_ns
    Limits limits
    bint ever_looped
    uint64_t taken
    uint64_t refused[REFUSAL_KINDS]


cdef struct PinnedTree:
    Tree view                   # a copy without names: its histories are pinned
    char* names                 # all names as in TreeArrays, then those of all authorities
    size_t names_size
    size_t authorities_size


# Pins a state of the tree, which may be read without the lock until it is unpinned. False: no memory.
cdef bint tree_pin(const Tree* tree, Lock* lock, PinnedTree* pinned) noexcept nogil
cdef void tree_unpin(PinnedTree* pinned) noexcept nogil
# Fills the arrays, all of which must have memory: of view.names.count - 1 frames and view.samples samples. Of
# the fields that are no arrays it sets all; `names` and `authorities` are those of `pinned`.
cdef void tree_export(const PinnedTree* pinned, TreeArrays* arrays) noexcept nogil
# Makes a tree of a zeroed Tree. NULL, or why it is not; TREE_LACKS_MEMORY, which is compared as a pointer,
# where it is not. tree_free is due in any case. Other threads may write into the arrays meanwhile: then it is
# refused, or holds any values that are valid. That the names are UTF-8 is up to the caller.
cdef const char* tree_import(const TreeArrays* arrays, Tree* tree) noexcept nogil
