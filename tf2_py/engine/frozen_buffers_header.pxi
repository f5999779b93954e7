"""Frozen files: write a tree to one, and map one."""

# Uses: tree_as_objects.

# Only the engine calls these. `names` and `authorities`: those of the tree that are known so far.
# Writes the content of a tree at one moment to a binary file that is at its beginning and can seek.
cdef int write_frozen(const Tree* tree, Lock* lock, file, list names, list authorities) except -1
# Makes a tree from a file, and returns the frozen_origin.FrozenFile. `is_copy`: read it into memory of this
# process. `expected`: the FrozenFile from which a pickled buffer was opened, whose samples are not checked
# again; or None. ValueError: it is not a frozen file, is damaged, or another one is expected; OSError: it
# cannot be opened. If it raises, there is no tree.
cdef object read_frozen(path, bint is_copy, expected, Tree* tree)
