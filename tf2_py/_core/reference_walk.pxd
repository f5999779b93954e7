"""
Walks in the order of tf2, the reference: up from the source to its root or first gap, then up from the
target. The order decides which of several errors is reported, and what a tree that contains a loop answers.
Lookups that succeed in trees without a loop do not need it.
"""

from libc.stdint cimport int64_t

from tf2_py._core.path cimport Path
from tf2_py._core.tree cimport Tree
from tf2_py._core.types cimport FrameId, Status

# The caller holds the tree's lock; target and source differ. The path at a time.
cdef Status reference_walk(const Tree* tree, FrameId target, FrameId source, int64_t time_ns,
                           Path* path) noexcept nogil
# The latest common time of the path at the newest stamps.
cdef Status reference_common_time(const Tree* tree, FrameId target, FrameId source, Path* path,
                                  int64_t* common_ns) noexcept nogil
