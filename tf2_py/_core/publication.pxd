"""What the owner of a shared tree writes into the segment, for those that follow it; see segment.pxd."""

from libc.stddef cimport size_t
from libc.stdint cimport uint64_t

from tf2_py._core.arena cimport Arena
from tf2_py._core.change cimport Change
from tf2_py._core.segment cimport Facts, Segment
from tf2_py._core.tree cimport Tree
from tf2_py._core.types cimport Incoming


cdef struct Publication:
    Segment* segment
    Arena arena             # of the tree's histories
    size_t rows_end         # offsets behind the committed memory of the parts that grow
    size_t names_end
    size_t authorities_end
    # As in the segment, in memory that nobody else writes, and that a forked child finds as it was.
    uint64_t sequence
    Facts facts


# Prepares an empty segment, and moves the histories of the tree into it. 0; -1: there is no memory for all of
# it, and the tree is as it was. `publication`: zeroed; publication_free is due in any case, after tree_free.
cdef int publication_begin(Publication* publication, Tree* tree, Segment* segment) noexcept nogil
cdef void publication_free(Publication* publication) noexcept nogil

# With the tree's lock held for writing, around all that changes the tree.
cdef void publication_open(Publication* publication) noexcept nogil
# `malformed`: messages.
cdef void publication_close(Publication* publication, const Tree* tree,
                            unsigned long long malformed) noexcept nogil
# Whether there is memory to tell of what an insert may add; before it.
cdef bint publication_has_room(Publication* publication, const Tree* tree,
                               const Incoming* incoming) noexcept nogil
# Likewise of an authority's name.
cdef bint publication_has_room_for(Publication* publication, size_t authority_size) noexcept nogil
# After an insert that changed this; after all histories changed; and after the tree was replaced by another.
cdef void publication_tell(Publication* publication, const Tree* tree, const Change* change) noexcept nogil
cdef void publication_tell_all(Publication* publication, const Tree* tree) noexcept nogil
# Moves the histories of a tree that is to replace the one told. False: there is no memory, and nothing has
# changed that is told.
cdef bint publication_adopt(Publication* publication, Tree* tree) noexcept nogil
cdef void publication_start_over(Publication* publication) noexcept nogil
# Without the lock: readers that were overtaken have their turn.
cdef void publication_pause(Publication* publication) noexcept nogil
