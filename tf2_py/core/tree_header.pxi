# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The tree: names, parents and every frame's history; and what an insert changes."""

cdef enum:
    # What tree_insert returns beside REFUSED_* bits:
    TREE_NO_MEMORY = 0x40000000     # there is no memory


cdef struct Limits:
    # What would exceed a limit is refused; but of a frame that has samples, the oldest makes room for others.
    uint32_t frames         # names
    size_t bytes            # of names and histories; one doubling of the table of names may exceed it


cdef struct Tree:
    Names names                     # a frame's id is its name's; id 0 is the reserved NO_PARENT
    Names authorities               # who has sent transforms; id 0: all beyond the limit
    History* histories              # by frame; [0] stays empty
    uint32_t* parents               # by frame: parent of the newest sample | MIXED_PARENTS; NO_FRAME: none
    uint32_t capacity               # frames allocated in the two arrays above
    Retention retention             # what each dynamic history keeps
    Limits limits                   # of the buffer
    uint32_t hidden                 # frames whose names count as unknown
    FrameId last_child              # of the last insert
    bint equals_file                # it was opened from a frozen file, and holds what that file holds
    uint64_t work                   # extra cost of all inserts so far; 1 is the cost of an ordinary insert
    uint64_t samples                # in all histories
    size_t history_bytes            # allocated for all histories
    uint64_t taken                  # transforms accepted, duplicates included
    uint64_t displaced              # samples that have made room for others
    uint64_t refused[REFUSAL_KINDS]     # transforms refused, by reason (bit number)


# What an insert has changed, for the lookups that wait.

cdef struct Change:
    # The shape is what decides which way a walk takes: names and links. Any insert into a frame with several
    # parents may change it: which of them answers depends on the neighbors of a sample, and on pruning.
    bint shape              # any failed lookup may have an answer now
    FrameId frame           # the child; NO_FRAME: no history was touched
    TimeRange covered       # times for which it has data only since then; may be too large
    int64_t horizon_ns      # data of earlier times is refused


cdef inline void change_begin(Change* change, bint shape) noexcept nogil:
    change.shape = shape
    change.frame = NO_FRAME
    change.covered.first = INT64_MAX
    change.covered.last = INT64_MIN
    change.horizon_ns = INT64_MIN


# Zero a Tree before tree_init, which returns 0, or -1 without memory: then tree_free is still due.
cdef int tree_init(Tree* tree, const Retention* retention, const Limits* limits) noexcept nogil
cdef void tree_free(Tree* tree) noexcept nogil
# The id of an authority; if there are too many, of a name that says so. NAME_NO_MEMORY: none.
cdef uint32_t tree_authority(Tree* tree, const char* name, size_t size) noexcept nogil
cdef FrameId tree_frame(const Tree* tree, const char* name, size_t size) noexcept nogil    # NO_FRAME: unknown

# Every reason to refuse a transform that does not depend on the tree: REFUSED_* bits. Strips one leading '/'
# from the names and normalizes the rotation, both in `incoming`, and fills its `squared_length`.
cdef uint32_t incoming_refusals(Incoming* incoming) noexcept nogil
# Inserts a transform. 0, or REFUSED_* bits or TREE_NO_MEMORY, and the tree is unchanged but for what was
# pruned. Changes `incoming` as incoming_refusals does. `change` is always filled, because even a transform
# that is too old adds its names; NULL: it is not needed.
cdef uint32_t tree_insert(Tree* tree, Incoming* incoming, uint32_t authority, bint is_static,
                          Change* change) noexcept nogil
# The id of a frame, a new one if its name is unknown. NO_FRAME: it failed, see `refused`, as of tree_insert.
# `guess`: as in names_find_guessed. `change` may be NULL.
cdef FrameId tree_intern_frame(Tree* tree, const char* name, size_t size, FrameId guess, Change* change,
                               uint32_t* refused) noexcept nogil
# Adds a frame whose name is unknown, regardless of the limits. NO_FRAME: there is no memory, or no free id.
cdef FrameId tree_add_frame(Tree* tree, const char* name, size_t size) noexcept nogil
# Gives a frame without samples a history, and takes that over. `parent`: of its newest sample.
cdef void tree_put_history(Tree* tree, FrameId frame, const History* history, FrameId parent) noexcept nogil
# Marks the frame of the transform just inserted as one whose rotation was unnormalized. Whether it is new.
cdef bint tree_mark_unnormalized(Tree* tree) noexcept nogil


cdef inline size_t tree_bytes(const Tree* tree) noexcept nogil:
    # Allocated for names and histories.
    return (tree.names.bytes + tree.authorities.bytes + tree.history_bytes
            + tree.capacity * (sizeof(History) + sizeof(uint32_t)))


cdef inline size_t tree_bytes_left(const Tree* tree) noexcept nogil:
    # That may still be allocated.
    cdef size_t used = tree_bytes(tree)
    return tree.limits.bytes - used if used < tree.limits.bytes else 0


cdef inline void tree_unhide(Tree* tree, FrameId frame, Change* change) noexcept nogil:
    # Its name counts as known, because a transform uses it. `change` may be NULL.
    if tree.histories[frame].is_hidden:
        tree.histories[frame].is_hidden = False
        tree.hidden -= 1
        if change != NULL:
            change.shape = True


cdef inline FrameId tree_newest_parent(const Tree* tree, FrameId frame) noexcept nogil:
    return tree.parents[frame] & ~<uint32_t>MIXED_PARENTS


cdef inline uint32_t tree_links(const History* history) noexcept nogil:
    # How many samples name all parents of a frame.
    return history.count if history.parent_changes else min(history.count, <uint32_t>1)


# Whether all walks up from a frame end at the same root, whatever data there is: no frame above it has
# several parents, and none is met twice.
cdef bint tree_has_one_way_up(const Tree* tree, FrameId frame) noexcept nogil
# Drops all dynamic histories; names, authorities and static transforms stay.
cdef void tree_clear(Tree* tree) noexcept nogil
# Drops all samples of a frame, and hides every frame that has no samples and is named by none. Returns
# whether the frame had samples.
cdef bint tree_forget(Tree* tree, FrameId frame) noexcept nogil


cdef struct PinnedTree:
    # Some frames, and all that were ever above them, at one moment. Lookups between these frames may read
    # `view` without the lock.
    Tree view               # only what a walk reads is set
    FrameId* frames         # those that `view` has
    uint32_t count          # of `frames`


# With the lock held. 0, or -1 without memory: then nothing is pinned.
cdef int tree_pin_above(const Tree* tree, const FrameId* frames, uint32_t count,
                        PinnedTree* pinned) noexcept nogil
cdef void tree_unpin(PinnedTree* pinned) noexcept nogil


# NULL, or which invariant does not hold.
cdef const char* tree_check(const Tree* tree) noexcept nogil
# The same for one frame; `where`: as in history_check.
cdef const char* tree_check_frame(const Tree* tree, FrameId frame, uint32_t* where) noexcept nogil
