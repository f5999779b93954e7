"""What a tree knows, as Python objects."""

from libc.stdint cimport int64_t

from tf2_py._core.lock cimport Lock
from tf2_py._core.tree cimport Tree

cdef enum:
    SLICE_FRAMES = 1024     # looked at under the lock at once, which takes some 20 microseconds

# Called by the engine alone. Each takes the lock to copy what they need, in slices, so that other threads do
# not wait longer for a larger tree. Python objects are made while it is free.
# The names of these frames, an iterable of ids; of all of them, NO_PARENT first, for None.
cdef list snapshot_names(const Tree* tree, Lock* lock, frames)
# A listings.FrameFacts for every frame that was ever a child, with `roots` also for those that were only ever
# parents, in the order in which their names were first used. Of more than SLICE_FRAMES frames it is no
# snapshot: the tree may change between two slices.
cdef list snapshot_frames(const Tree* tree, Lock* lock, bint roots)
# The stamps of the oldest and of the newest sample of all dynamic frames; whether there is one.
cdef bint snapshot_span(const Tree* tree, Lock* lock, int64_t* oldest_ns, int64_t* newest_ns) noexcept nogil
