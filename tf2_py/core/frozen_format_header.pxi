# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Frozen files: a tree as the bytes of a file that processes map, and of a state in which a buffer is pickled
and copied. tests/support/frozen_format.py reads and changes them in Python.

A header, a FrozenFrame for each frame with samples and for each parent of samples, a FrozenName for each
authority, all names, and the samples of each frame as they lie in a History: stamps in ascending order, then
samples, each from a whole line of 64 bytes on. Frames have the ids 1, 2, ... in their order. The names are
UTF-8 without a leading slash or an end, first of the frames, then of the authorities, without gaps. Zeros
fill each last line. The header and all up to the first stamp is the index.

A sample has 64 bytes: the translation x y z in meters and the normalized rotation x y z w as float64, the id
of the parent as uint32, and four bytes that are 0.
"""

cdef enum:
    FROZEN_VERSION = 3
    FROZEN_PARENT = 1           # flag of a frame: History.is_parent


cdef struct FrozenHeader:
    # 128 bytes. All numbers of a file are little-endian, as those of the machines that this project is for.
    unsigned char[8] magic
    uint32_t version            # FROZEN_VERSION
    uint32_t flags              # none is defined
    uint64_t file_bytes         # of the whole file
    uint64_t index_bytes        # of the index, whole lines
    uint64_t checksum           # zlib.crc32 of the index, computed while this field is 0
    int64_t cache_time_ns
    uint64_t max_bytes
    uint32_t max_frames
    uint32_t frame_count        # with those that are only parents
    uint32_t authority_count
    uint32_t reserved           # 0, as all that is reserved
    uint64_t sample_count       # of all frames
    uint64_t samples_checksum   # zlib.crc32 of all behind the index
    uint64_t[5] reserved_line


cdef struct FrozenFrame:
    # One line.
    uint64_t name_start         # from the beginning of the file
    uint32_t name_size          # bytes
    uint16_t kind               # a HistoryKind
    uint16_t flags
    uint32_t authority          # the number of its FrozenName; 0 without samples
    uint32_t newest_parent      # of the newest sample; 0 without samples
    uint32_t count              # samples
    uint32_t parent_changes     # as in a History, as are the next but two
    uint64_t data_start         # of the stamps, from the beginning of the file; 0 without samples
    uint64_t reserved
    int64_t oldest_ns
    int64_t newest_ns


cdef struct FrozenName:
    uint64_t start              # from the beginning of the file
    uint32_t size               # bytes
    uint32_t reserved


cdef struct FrozenProblem:
    # Why a file is not what it should be.
    const char* text            # NULL: it is; "": there is no memory
    FrameId frame               # NO_FRAME: it is not about a frame
    uint32_t sample             # the index; UINT32_MAX: it is not about a sample


cdef inline size_t frozen_stamp_bytes(uint32_t count) noexcept nogil:
    # Of the stamps of a frame in a file, whole lines.
    return (count * sizeof(int64_t) + LINE_BYTES - 1) // LINE_BYTES * LINE_BYTES


cdef void frozen_header_begin(FrozenHeader* header) noexcept nogil
# NULL, or why it is not the header of a frozen file that this version reads, whatever the file contains.
# A shorter file: with zeros behind it.
cdef const char* frozen_check_format(const FrozenHeader* header, uint64_t file_bytes) noexcept nogil
# NULL, or why it is not the header of a file of this size.
cdef const char* frozen_check_header(const FrozenHeader* header, uint64_t file_bytes) noexcept nogil
# Whether header and index are those of a file of this size, which is in memory and holds a header at least.
# The checksum of the index is left to the caller.
cdef FrozenProblem frozen_check_index(const FrozenHeader* header, uint64_t file_bytes) noexcept nogil
# Makes a tree of such a file, after frozen_check_index. `mapping`: of the file, where the samples stay; NULL:
# they are copied. `checks_samples`: refuse samples that no tree holds; without it, they must have been
# checked before. tree_free is due in any case.
cdef FrozenProblem frozen_read(const FrozenHeader* header, FileMapping* mapping, bint checks_samples,
                               Tree* tree) noexcept nogil
