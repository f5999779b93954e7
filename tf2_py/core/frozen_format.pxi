# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read frozen files: check every number of one in memory, and make a tree of it."""

cdef extern from *:
    """
    static const unsigned char TF2_FROZEN_MAGIC[8] = {0x89, 'T', 'F', '2', '\\r', '\\n', 0x1a, '\\n'};
    """
    const unsigned char* FROZEN_MAGIC "TF2_FROZEN_MAGIC"


cdef void frozen_header_begin(FrozenHeader* header) noexcept nogil:
    memset(header, 0, sizeof(FrozenHeader))
    memcpy(header.magic, FROZEN_MAGIC, sizeof(header.magic))
    header.version = FROZEN_VERSION


cdef inline FrozenProblem _problem_of(const char* text) noexcept nogil:
    cdef FrozenProblem problem
    problem.text = text
    problem.frame = NO_FRAME
    problem.sample = UINT32_MAX
    return problem


cdef inline FrozenProblem _problem_of_frame(FrameId frame, const char* text) noexcept nogil:
    cdef FrozenProblem problem = _problem_of(text)
    problem.frame = frame
    return problem


cdef bint _is_zero(const void* bytes, size_t size) noexcept nogil:
    cdef size_t i
    for i in range(size):
        if (<const char*>bytes)[i] != 0:
            return False
    return True


cdef const char* frozen_check_format(const FrozenHeader* header, uint64_t file_bytes) noexcept nogil:
    if memcmp(header.magic, FROZEN_MAGIC, sizeof(header.magic)) != 0:
        return "it is not a frozen buffer written by Buffer.freeze"
    if file_bytes >= sizeof(FrozenHeader) and header.version != FROZEN_VERSION:
        return "another version of tf2-ros-cython wrote it: freeze the buffer again with this one"
    return NULL


cdef const char* frozen_check_header(const FrozenHeader* header, uint64_t file_bytes) noexcept nogil:
    cdef uint64_t records
    cdef uint64_t names = <uint64_t>header.frame_count + header.authority_count
    cdef const char* text = frozen_check_format(header, file_bytes)
    if text != NULL:
        return text
    if file_bytes < sizeof(FrozenHeader):
        return "it ends within its header"
    if header.file_bytes != file_bytes:
        return "its size is not the one in its header"
    # None of these sums can overflow: both counts have 32 bits.
    records = sizeof(FrozenHeader) + <uint64_t>header.frame_count * sizeof(FrozenFrame)
    records += <uint64_t>header.authority_count * sizeof(FrozenName)
    # A name has up to 2^32 bytes.
    if (header.index_bytes > file_bytes or header.index_bytes % LINE_BYTES or header.index_bytes < records
            or (header.index_bytes - records) // LINE_BYTES > names << 26):
        return "the size of its index is wrong"
    if header.flags:
        return "its header has an unknown flag"
    if header.reserved or not _is_zero(header.reserved_line, sizeof(header.reserved_line)):
        return "a reserved byte of its header is not 0"
    if header.cache_time_ns < 0 or header.max_frames == 0 or header.max_bytes == 0:
        return "its cache time or limits are out of range"
    return NULL


cdef inline const FrozenFrame* _frames_of(const FrozenHeader* header) noexcept nogil:
    return <const FrozenFrame*>(header + 1)


cdef struct Ends:
    # Where what has been checked ends, from the beginning of the file.
    uint64_t names
    uint64_t samples


cdef bint _is_next_name(const FrozenHeader* header, uint64_t start, uint32_t size, Ends* ends) noexcept nogil:
    # Whether a text lies behind the one before, in the index, and may be a name.
    cdef const unsigned char* text = <const unsigned char*>header + ends.names
    if start != ends.names or size > header.index_bytes - start:
        return False
    ends.names += size
    # First the zeros: a hole in a file may be long.
    return (size == 0 or memchr(text, 0, size) == NULL) and is_utf8(text, size)


cdef const char* _frame_problem(const FrozenHeader* header, FrameId frame, Ends* ends) noexcept nogil:
    cdef const FrozenFrame* record = _frames_of(header) + (frame - 1)
    cdef uint64_t bytes = frozen_stamp_bytes(record.count) + <uint64_t>record.count * sizeof(Sample)
    if record.name_size == 0 or not _is_next_name(header, record.name_start, record.name_size, ends):
        return "its name in the index is invalid"
    if record.flags & ~FROZEN_PARENT:
        return "its flags are unknown"
    if record.reserved:
        return "a reserved byte of it is not 0"
    if record.kind == HISTORY_NONE:
        if (record.authority or record.newest_parent or record.count or record.parent_changes
                or record.data_start or record.oldest_ns or record.newest_ns):
            return "it has no samples, but fields about samples"
        if not record.flags & FROZEN_PARENT:
            return "it is neither a child nor a parent"
        return NULL
    if record.kind != HISTORY_DYNAMIC and record.kind != HISTORY_STATIC:
        return "its kind is unknown"
    if record.count == 0 or record.count > LAST_CAPACITY or record.parent_changes >= record.count:
        return "its number of samples or of parent changes is out of range"
    if record.kind == HISTORY_STATIC and record.count != 1:
        return "it is static, but has several samples"
    if record.authority >= header.authority_count:
        return "its authority is not in the file"
    if record.newest_parent == 0 or record.newest_parent > header.frame_count:
        return "its parent is not in the file"
    if record.data_start != ends.samples or bytes > header.file_bytes - ends.samples:
        return "the offset of its samples is wrong"
    ends.samples += bytes
    return NULL


cdef FrozenProblem frozen_check_index(const FrozenHeader* header, uint64_t file_bytes) noexcept nogil:
    # A header may claim an index of any size. What is checked here bounds how much of it is read.
    cdef const FrozenName* authorities
    cdef const char* text = frozen_check_header(header, file_bytes)
    cdef uint64_t samples = 0
    cdef uint32_t i
    cdef Ends ends
    if text != NULL:
        return _problem_of(text)
    authorities = <const FrozenName*>(_frames_of(header) + header.frame_count)
    ends.names = <uint64_t>(<const char*>(authorities + header.authority_count) - <const char*>header)
    ends.samples = header.index_bytes
    for i in range(header.frame_count):
        # Ids are smaller than a flag of the tree.
        if i == LAST_ID:
            return _problem_of("it has too many frames")
        text = _frame_problem(header, i + 1, &ends)
        if text != NULL:
            return _problem_of_frame(i + 1, text)
        samples += _frames_of(header)[i].count
    if samples != header.sample_count or ends.samples != header.file_bytes:
        return _problem_of("its header and its frames disagree on the number of samples")
    for i in range(header.authority_count):
        if not _is_next_name(header, authorities[i].start, authorities[i].size, &ends):
            return _problem_of("the name of an authority is invalid")
        if authorities[i].reserved:
            return _problem_of("a reserved byte of an authority is not 0")
    if (header.index_bytes - ends.names >= LINE_BYTES
            or not _is_zero(<const char*>header + ends.names, header.index_bytes - ends.names)):
        return _problem_of("its index does not end with names and zeros")
    return _problem_of(NULL)


cdef const char* _read_frame(const FrozenHeader* header, FileMapping* mapping, FrameId frame,
                             const uint32_t* authorities, Tree* tree) noexcept nogil:
    cdef const FrozenFrame* record = _frames_of(header) + (frame - 1)
    cdef const char* data = <const char*>header + record.data_start
    cdef const int64_t* stamps = <const int64_t*>data
    cdef const Sample* samples = <const Sample*>(data + frozen_stamp_bytes(record.count))
    cdef History history
    cdef int failed
    memset(&history, 0, sizeof(History))
    history.authority = NAME_UNKNOWN
    history.is_parent = record.flags & FROZEN_PARENT
    if record.kind != HISTORY_NONE:
        history.kind = HISTORY_DYNAMIC if record.kind == HISTORY_DYNAMIC else HISTORY_STATIC
        if mapping != NULL:
            failed = history_map(&history, mapping, stamps, samples, record.count)
        else:
            failed = history_import(&history, stamps, samples, record.count)
        if failed:
            return ""
        history.parent_changes = record.parent_changes
        history.oldest_ns = record.oldest_ns
        history.newest_ns = record.newest_ns
        history.authority = authorities[record.authority]
    tree_put_history(tree, frame, &history, record.newest_parent)
    return NULL


cdef const char* _add_names(const FrozenHeader* header, Tree* tree, uint32_t* authorities,
                            FrameId* frame) noexcept nogil:
    # `frame`: to which a problem belongs.
    cdef const char* bytes = <const char*>header
    cdef const FrozenFrame* frames = _frames_of(header)
    cdef const FrozenName* senders = <const FrozenName*>(frames + header.frame_count)
    cdef const char* name
    cdef uint32_t i
    frame[0] = NO_FRAME
    for i in range(header.authority_count):
        authorities[i] = names_intern(&tree.authorities, bytes + senders[i].start, senders[i].size)
        if authorities[i] == NAME_NO_MEMORY:
            return ""
    for i in range(header.frame_count):
        frame[0] = i + 1
        name = bytes + frames[i].name_start
        # The reserved name is known, too.
        if names_find(&tree.names, name, frames[i].name_size) != NAME_UNKNOWN:
            return "its name is reserved or a duplicate"
        if tree_add_frame(tree, name, frames[i].name_size) == NO_FRAME:
            return ""
    return NULL


cdef FrozenProblem _samples_problem(const FrozenHeader* header, const Tree* tree) noexcept nogil:
    # All that a tree has to hold, on which its memory safety depends.
    cdef FrozenProblem problem = _problem_of(NULL)
    cdef FrameId frame
    cdef uint32_t where
    for frame in range(1, header.frame_count + 1):
        problem = _problem_of_frame(frame, tree_check_frame(tree, frame, &where))
        if problem.text != NULL:
            problem.sample = where if where < _frames_of(header)[frame - 1].count else UINT32_MAX
            return problem
    return problem


cdef FrozenProblem frozen_read(const FrozenHeader* header, FileMapping* mapping, bint checks_samples,
                               Tree* tree) noexcept nogil:
    cdef uint32_t* authorities = <uint32_t*>malloc((header.authority_count + 1) * sizeof(uint32_t))
    cdef Retention retention
    cdef Limits limits
    cdef const char* text = ""
    cdef FrameId frame = NO_FRAME
    retention.cache_time_ns = header.cache_time_ns
    limits.frames = header.max_frames
    limits.bytes = header.max_bytes
    memset(tree, 0, sizeof(Tree))
    if tree_init(tree, &retention, &limits) == 0 and authorities != NULL:
        text = _add_names(header, tree, authorities, &frame)
    while text == NULL and frame != NO_FRAME:
        text = _read_frame(header, mapping, frame, authorities, tree)
        frame -= text == NULL
    free(authorities)
    if text != NULL:
        return _problem_of_frame(frame, text)
    tree.taken = header.sample_count
    tree.equals_file = mapping != NULL
    return _samples_problem(header, tree) if checks_samples else _problem_of(NULL)
