"""The tree: names, parents and every frame's history."""

from libc.stdint cimport int64_t, uint32_t, uint64_t

from tf2_py._core.arena cimport Arena
from tf2_py._core.cache cimport Cache, cache_parent_of
from tf2_py._core.cache_find cimport cache_parent_at
from tf2_py._core.change cimport Change
from tf2_py._core.mirror_state cimport Mirror
from tf2_py._core.names cimport Names
from tf2_py._core.types cimport MIXED_PARENTS, NEWEST, NO_FRAME, REFUSAL_KINDS, FrameId, Incoming

cdef enum:
    TREE_NO_MEMORY = 0x40000000     # what tree_insert returns without memory; no REFUSED_* bit


cdef struct Limits:
    # What would exceed a limit is refused; nothing is dropped.
    uint32_t frames         # names
    size_t bytes            # of names and histories; one doubling of the table of names may exceed it
    uint32_t waiters        # lookups that wait


cdef struct Tree:
    Mirror* mirror                  # the tree is a copy of another process's: see mirror.pxd; NULL: it is not
    Arena* arena                    # that gives memory for histories, which others read; NULL: malloc
    Names names                     # a frame's id is its name's; id 0 is the reserved NO_PARENT
    Names authorities               # who has sent transforms; id 0: all beyond the limit
    Cache* caches                   # by frame; [0] stays empty
    uint32_t* parents               # by frame: parent of the newest sample | MIXED_PARENTS; NO_FRAME: none
    uint32_t capacity               # frames allocated in the two arrays above
    int64_t cache_time_ns           # how far a history reaches back from its newest stamp; >= 0
    Limits limits                   # of the buffer
    bint is_untold                  # the waiters do not yet know what leaving another process's has brought
    bint ever_looped                # a parent link once closed a loop: then walks are made in tf2's order
    uint64_t work                   # extra cost of all inserts so far; 1 is the cost of an ordinary insert
    uint64_t samples                # in all histories
    size_t history_bytes            # allocated for all histories
    uint64_t taken                  # transforms accepted, duplicates included
    uint64_t refused[REFUSAL_KINDS]     # transforms refused, by reason (bit number)


cdef extern from *:
    """
    #define TF2_DEFAULT_CACHE_TIME_NS 10000000000LL
    """
    const int64_t DEFAULT_CACHE_TIME_NS "TF2_DEFAULT_CACHE_TIME_NS"     # as tf2's

# A text, compared as a pointer.
cdef const char* TREE_LACKS_MEMORY


# Zero a Tree before tree_init; after a failed tree_init, tree_free is still due.
cdef int tree_init(Tree* tree, int64_t cache_time_ns, const Limits* limits) noexcept nogil  # 0; -1: no memory
cdef void tree_free(Tree* tree) noexcept nogil
# The id of an authority; where there are too many, of a name that says so. NAME_NO_MEMORY: none.
cdef uint32_t tree_authority(Tree* tree, const char* name, size_t size) noexcept nogil
cdef FrameId tree_frame(const Tree* tree, const char* name, size_t size) noexcept nogil    # NO_FRAME: unknown

# Every reason to refuse a transform whatever the tree holds: REFUSED_* bits. Strips one leading '/' from the
# names and normalises the rotation, both in `incoming`.
cdef uint32_t incoming_refusals(Incoming* incoming) noexcept nogil
# Inserts a transform. 0, or REFUSED_* bits, or TREE_NO_MEMORY and the tree holds what it held.
# Changes `incoming` as incoming_refusals does. `change` is filled whatever the outcome: a transform that is
# too old adds its names, too. NULL: it is not needed.
cdef uint32_t tree_insert(Tree* tree, Incoming* incoming, uint32_t authority, bint is_static,
                          Change* change) noexcept nogil
# For REFUSED_* bits that tree_insert did not return.
cdef void tree_count_refused(Tree* tree, uint32_t refused) noexcept nogil
# The parent that a walk at a time, or at NEWEST, follows; NO_FRAME: there is none, or it is not known.
cdef FrameId tree_parent(const Tree* tree, FrameId frame, int64_t time_ns) noexcept nogil
# The parent that the history of a frame names for a time; NO_FRAME: none, or nonsense, for another process
# may be changing it.
cdef inline FrameId tree_parent_at(const Tree* tree, FrameId frame, int64_t time_ns) noexcept nogil:
    cdef FrameId parent = cache_parent_at(&tree.caches[frame], time_ns)
    return parent if parent < tree.names.count else <FrameId>NO_FRAME


cdef inline FrameId tree_newest_parent(const Tree* tree, FrameId frame) noexcept nogil:
    return tree.parents[frame] & ~<uint32_t>MIXED_PARENTS


# NO_FRAME: there are no samples, or the oldest one is nonsense, as above.
cdef inline FrameId tree_oldest_parent(const Tree* tree, FrameId frame) noexcept nogil:
    cdef const Cache* cache = &tree.caches[frame]
    cdef FrameId parent = cache_parent_of(cache, 0) if cache.count else <FrameId>NO_FRAME
    return parent if parent < tree.names.count else <FrameId>NO_FRAME


# Drops all dynamic histories; names, authorities and static transforms stay.
cdef void tree_clear(Tree* tree) noexcept nogil
# Finds out anew what follows from the histories: the frames' parents, whether they form loops, the counts.
cdef void tree_relink(Tree* tree) noexcept nogil
# Allocated for names and histories.
cdef size_t tree_bytes(const Tree* tree) noexcept nogil
# NULL, or which invariant does not hold, or TREE_LACKS_MEMORY: it could not be checked whether all do.
cdef const char* tree_check(const Tree* tree) noexcept nogil
# A new frame, whatever the limits. NO_FRAME: it failed, see `refused`. `change` may be NULL. The name must be
# unknown.
cdef FrameId tree_add_frame(Tree* tree, const char* name, size_t size, Change* change,
                            uint32_t* refused) noexcept nogil
