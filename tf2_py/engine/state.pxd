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


# The state of a buffer as Python objects, for pickles, copies and files.

# Only the engine calls these. `names` and `authorities`: those of the tree that are known so far.
cdef dict state_of(const Tree* tree, Lock* lock, list names, list authorities)
# Makes a tree by inserting what such a state holds. ValueError: a transform is refused. If it raises, there
# is no tree.
cdef int read_state(dict state, Tree* tree) except -1
