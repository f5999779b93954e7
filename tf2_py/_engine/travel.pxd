"""The state of a buffer as Python objects, for pickles, copies and files."""

from tf2_py._core.lock cimport Lock
from tf2_py._core.tree cimport Tree

# Called by the engine alone. What the lock does not guard is given by the caller.
cdef dict state_of(const Tree* tree, Lock* lock, unsigned long long malformed)
# Makes a tree of such a state. ValueError tells what is wrong with it; with it and MemoryError there is none.
cdef int read_state(dict state, Tree* tree, unsigned long long* malformed) except -1
