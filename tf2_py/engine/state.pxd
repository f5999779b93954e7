"""The content of a tree as Python objects."""

cdef enum:
    SLICE_FRAMES = 1024     # looked at under the lock at once, which takes some 20 microseconds

# Only the engine calls these. Each takes the lock to copy what it needs, in slices, so that other threads do
# not wait longer for a larger tree. It makes Python objects while the lock is free.
# Appends the names that `known` lacks, in the order of their ids.
cdef int learn_names(const Names* names, Lock* lock, list known) except -1
# A listings.FrameFacts for every frame that was ever a child, with `roots` also for those that were only ever
# parents, in the order in which their names were first used. With more than SLICE_FRAMES frames it is not a
# snapshot: the tree may change between two slices. `names` and `authorities` are those known so far.
cdef list snapshot_frames(const Tree* tree, Lock* lock, bint roots, list names, list authorities)
# The stamps of the oldest and of the newest sample of all dynamic frames; whether there is one.
cdef bint snapshot_span(const Tree* tree, Lock* lock, int64_t* oldest_ns, int64_t* newest_ns) noexcept nogil


# A whole tree as flat arrays, for pickles and files: everything that affects answers and listings.

cdef struct FrameRow:
    # A frame without its samples; see History.
    uint32_t kind               # a HistoryKind
    uint32_t count
    uint32_t authority
    uint32_t flags              # ROW_IS_PARENT, ROW_IS_HIDDEN
    # These two make the limit of bytes refuse the same transforms as before.
    uint32_t capacity
    uint32_t mostly_empty_for


cdef enum:
    FRAME_ROW_COLUMNS = 6       # uint32_t each
    ROW_IS_PARENT = 1
    ROW_IS_HIDDEN = 2


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
# Fills the arrays, which must have memory for view.names.count - 1 frames and view.samples samples, and sets
# all other fields; `names` and `authorities` are those of `pinned`.
cdef void tree_export(const PinnedTree* pinned, TreeArrays* arrays) noexcept nogil
# Makes a tree of a zeroed Tree. NULL, or what is wrong; TREE_LACKS_MEMORY is compared as a pointer. tree_free
# is due in any case. Other threads may write into the arrays meanwhile: then the tree is refused, or holds
# any valid values. The caller must check that the names are UTF-8.
cdef const char* tree_import(const TreeArrays* arrays, Tree* tree) noexcept nogil


# The state of a buffer as Python objects, for pickles, copies and files.

# Only the engine calls these. The caller passes what the lock does not guard.
cdef dict state_of(const Tree* tree, Lock* lock, unsigned long long malformed)
# Makes a tree of such a state. ValueError states what is wrong with it. If it raises, there is no tree.
cdef int read_state(dict state, Tree* tree, unsigned long long* malformed) except -1
