"""
A tree that follows the one of another process, in memory that this process can only read.

Names, parents and the places of the histories are copied into an ordinary Tree, whose histories lie in the
other process's memory: so everything that reads a tree reads this one. The owner changes the memory
meanwhile, and takes no notice. So a read is repeated until it was not disturbed, see reading.pxd; what it has
found before is nonsense, but never leads beyond the memory: places are checked when they are copied, ids when
they are read.
"""

from tf2_py._core.cache cimport Cache
from tf2_py._core.mirror_state cimport Mirror
from tf2_py._core.segment cimport Segment, fence_acquire, load64, segment_head
from tf2_py._core.tree cimport Tree
from tf2_py._core.types cimport FrameId

# NULL, or why the memory is no segment that can be followed.
cdef const char* segment_problem(const Segment* segment) noexcept nogil
# Makes an initialised tree without frames follow a segment. `mirror`: zeroed, and kept until mirror_free.
cdef void mirror_begin(Tree* tree, Mirror* mirror, Segment* segment) noexcept nogil
cdef void mirror_free(Mirror* mirror) noexcept nogil
cdef inline bint mirror_is_current(const Tree* tree) noexcept nogil:
    # What was read before belongs to the state of the owner that the tree shows.
    fence_acquire()
    return load64(&segment_head(tree.mirror.segment).sequence) == tree.mirror.sequence


# With the tree's lock held for writing. Makes the tree as its owner's is; where it cannot be followed any
# more, it leaves.
cdef void mirror_catch_up(Tree* tree) noexcept nogil
# Likewise. The histories become the tree's own, as ordinary memory; `tree.mirror` is NULL then. False: there
# is no memory for them, and the tree is a mirror as before. At any cost, what has no memory is lost.
cdef bint mirror_leave(Tree* tree, bint at_any_cost) noexcept nogil
# Whether copies of caches still say where the samples lie, and none of those has changed: what was read of
# them up to now is valid. `frames`: their frames.
cdef bint mirror_holds(const Mirror* mirror, const FrameId* frames, const Cache* copies,
                       size_t count) noexcept nogil
