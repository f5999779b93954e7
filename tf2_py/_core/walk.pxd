"""Walks through the tree: the path between two frames, and the answer along it."""

from libc.stdint cimport int64_t

from tf2_py._core.path cimport Path
from tf2_py._core.tree cimport Tree
from tf2_py._core.types cimport FrameId, Status, Transform

# All of these read the tree only; the caller holds its lock. `time_ns` 0 asks for the latest common time.
# `out` NULL only asks whether there is an answer. `stamp_ns` receives the time looked up. `path` is scratch
# memory and holds the path after a successful lookup.
cdef Status walk_lookup(const Tree* tree, FrameId target, FrameId source, int64_t time_ns, Path* path,
                        Transform* out, int64_t* stamp_ns) noexcept nogil
cdef Status walk_common_time(const Tree* tree, FrameId target, FrameId source, Path* path,
                             int64_t* common_ns) noexcept nogil
# The path alone, at a time or at NEWEST, for trees in which no link ever closed a loop; target and source
# differ. False: there is none, or it has too many hops. `mixed` is set where a visited frame had several
# parents, so that the path may differ at other times.
cdef bint walk_climb(const Tree* tree, FrameId target, FrameId source, int64_t time_ns, Path* path,
                     bint* mixed) noexcept nogil
