# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Rewriting the past: replacing what frames have from the first to the last of some stamps.

A call first builds the new history of each frame. It exchanges old and new histories only when all are
built, so if memory runs out, nothing has changed. Of a frame, either all transforms of the call are accepted,
or none.
"""

cdef struct Given:
    # One transform of a call.
    uint32_t which          # its frame, an index of `frames`
    int64_t stamp_ns        # in a static frame 0, so that they stay in their order; the last one counts
    size_t entry            # its place in the batch
    FrameId parent          # NO_FRAME: it has no id yet


cdef struct Replacement:
    # What a call does to one frame.
    FrameId frame           # NO_FRAME: it has no id, because its transforms are invalid
    size_t first            # its transforms: from this index of `given` ...
    size_t end              # ... to the one before this
    bint is_refused
    bint is_built
    uint64_t displaced      # if `is_built`: samples that have made room
    History history         # if `is_built`, what the frame becomes; after the exchange, what it was


cdef struct Replacing:
    Given* given            # as many as the batch has entries; by frame, then by stamp, then in their order
    Replacement* frames     # in the order in which the call names them first
    uint32_t count          # of `frames`
    int64_t growth          # by how many bytes the histories that are built exceed those that they replace


# Sorts the transforms of a batch that has some, and refuses the invalid ones. 0, or -1 without memory. Call
# replacing_free afterwards, best without the lock, because the old histories are freed there.
cdef int replacing_begin(Replacing* replacing, Batch* batch) noexcept nogil
cdef void replacing_free(Replacing* replacing) noexcept nogil
# Replaces samples, and fills the outcome of the batch and of its entries. False: there is no memory, and
# nothing has changed. All waiters may have an answer now.
cdef bint replacing_apply(Replacing* replacing, Tree* tree, Batch* batch, uint32_t authority) noexcept nogil
