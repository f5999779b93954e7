"""The tree: names, parents and every frame's history."""

from libc.stdint cimport int64_t, uint32_t, uint64_t

from tf2_py._cache cimport Cache
from tf2_py._names cimport Names
from tf2_py._types cimport REFUSAL_KINDS, FrameId, Incoming

cdef enum:
    MIXED_PARENTS = 0x80000000      # flag in Tree.parents: the history holds more than one parent
    TREE_NO_MEMORY = 0x40000000     # what tree_insert answers where nothing could be allocated


cdef struct Tree:
    Names names                     # a frame's id is its name's; id 0 is the reserved NO_PARENT
    Names authorities
    Cache* caches                   # by frame; [0] stays unborn
    uint32_t* parents               # by frame: parent of the newest sample | MIXED_PARENTS; NO_FRAME: none
    uint32_t capacity               # frames allocated in the two arrays above
    int64_t cache_time_ns           # how far a history reaches back; >= 0
    bint ever_looped                # a parent link once closed a loop: walks keep to the reference's order
    uint64_t changes                # how often a path may have become another: new names, links, parents
    uint64_t taken                  # transforms taken
    uint64_t refused[REFUSAL_KINDS]     # transforms refused, by reason (bit number)


# Zero a Tree before tree_init; after a failed tree_init, tree_free is still due.
cdef int tree_init(Tree* tree, int64_t cache_time_ns) noexcept nogil    # 0, or -1: no memory
cdef void tree_free(Tree* tree) noexcept nogil
cdef FrameId tree_frame(const Tree* tree, const char* name, size_t size) noexcept nogil    # NO_FRAME: unknown

# Takes a transform, or says why not: 0, or REFUSED_* bits, or TREE_NO_MEMORY and the tree is as it was but
# for names. Strips one leading '/' from the names and normalises the rotation, both in `incoming`. `changed`
# receives the child, where it is taken or too old.
cdef uint32_t tree_insert(Tree* tree, Incoming* incoming, uint32_t authority, bint is_static,
                          FrameId* changed) noexcept nogil
cdef void tree_clear(Tree* tree) noexcept nogil
cdef size_t tree_bytes(const Tree* tree) noexcept nogil
cdef uint64_t tree_samples(const Tree* tree) noexcept nogil
cdef const char* tree_check(const Tree* tree) noexcept nogil    # NULL, or which invariant does not hold
