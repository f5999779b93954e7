"""The content of a tree as Python objects."""

# Uses: messages, arrays.

# Each takes the lock to copy what it needs, and makes Python objects while the lock is free. `names` and
# `authorities`: those of the tree that are known so far.
# Appends the names that `known` lacks, in the order of their ids.
cdef int learn_names(const Names* names, Lock* lock, list known) except -1
# Makes `view` a copy that may be read without the lock, except for its names. Hold the GIL until these are
# known, too, so that they are those of the same tree.
cdef int pin_tree(const Tree* tree, Lock* lock, Tree* view) except -1
cdef void unpin_tree(Tree* view) noexcept nogil
# A listings.FrameFacts for every frame that was ever a child, with `roots` also for those that were only ever
# parents, in the order in which their names were first used, all at one moment.
cdef list snapshot_frames(const Tree* tree, Lock* lock, bint roots, list names, list authorities)


# The state of a buffer as Python objects, for pickles, copies and files.

cdef dict state_of(const Tree* tree, Lock* lock, list names, list authorities)
# Makes a tree by inserting what such a state holds. ValueError: a transform is refused. If it raises, there
# is no tree.
cdef int read_state(dict state, Tree* tree) except -1
