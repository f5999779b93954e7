"""What a tree knows, as Python objects."""

from tf2_py._lock cimport Lock
from tf2_py._tree cimport Tree

# Both take the lock to copy what they need, and make Python objects only after they have given it back.
# The names of these frames, an iterable of ids; of all of them, NO_PARENT first, for None.
cdef list snapshot_names(const Tree* tree, Lock* lock, frames)
# A _listings.FrameFacts for every frame that was ever a child, in the order in which their names came.
cdef list snapshot_frames(const Tree* tree, Lock* lock)
