"""Read frozen files: check every number of a mapping, and make a tree whose histories lie in it."""

cdef extern from *:
    """
    static const unsigned char TF2_FROZEN_MAGIC[8] = {0x89, 'T', 'F', '2', '\\r', '\\n', 0x1a, '\\n'};
    #define TF2_PRIME 0x9E3779B185EBCA87ULL
    #define TF2_MIXED(lane, word) tf2_rotated(((lane) ^ (word)) * TF2_PRIME)
    static inline uint64_t tf2_rotated(uint64_t x) { return (x << 29) | (x >> 35); }
    """
    const unsigned char* FROZEN_MAGIC "TF2_FROZEN_MAGIC"
    const uint64_t PRIME "TF2_PRIME"
    uint64_t _mixed "TF2_MIXED"(uint64_t lane, uint64_t word) nogil


cdef void checksum_begin(Checksum* checksum) noexcept nogil:
    cdef uint32_t i
    for i in range(8):
        checksum.lanes[i] = (i + 1) * PRIME
    checksum.size = 0


cdef void checksum_add(Checksum* checksum, const void* lines, size_t size) noexcept nogil:
    # The lanes do not depend on each other, so that the processor computes them at once.
    cdef uint64_t[8] lanes
    cdef uint64_t[8] words
    cdef const char* line = <const char*>lines
    cdef size_t i
    cdef int j
    memcpy(lanes, checksum.lanes, sizeof(lanes))
    for i in range(size // LINE_BYTES):
        memcpy(words, line + i * LINE_BYTES, LINE_BYTES)
        for j in range(8):
            lanes[j] = _mixed(lanes[j], words[j])
    memcpy(checksum.lanes, lanes, sizeof(lanes))
    checksum.size += size


cdef uint64_t checksum_end(const Checksum* checksum) noexcept nogil:
    cdef uint64_t end = checksum.size
    cdef int j
    for j in range(8):
        end = _mixed(end, checksum.lanes[j])
    return end ^ (end >> 32)


cdef uint64_t frozen_checksum(const void* index, size_t size) noexcept nogil:
    cdef Checksum checksum
    cdef FrozenHeader header
    memcpy(&header, index, sizeof(FrozenHeader))
    header.checksum = 0
    checksum_begin(&checksum)
    checksum_add(&checksum, &header, sizeof(FrozenHeader))
    checksum_add(&checksum, <const char*>index + sizeof(FrozenHeader), size - sizeof(FrozenHeader))
    return checksum_end(&checksum)


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


cdef const char* _header_problem(const FileMapping* mapping) noexcept nogil:
    cdef const FrozenHeader* header = <const FrozenHeader*>mapping.start
    cdef uint64_t records
    if mapping.size < sizeof(header.magic) or memcmp(header.magic, FROZEN_MAGIC, sizeof(header.magic)) != 0:
        return "it is not a frozen buffer"
    if mapping.size < sizeof(FrozenHeader):
        return "it is cut off in its header"
    if header.version != FROZEN_VERSION:
        return "it has another version of the format than 1"
    if header.file_bytes != mapping.size:
        return "its size is not that in its header: it is cut off, or was changed"
    # None of these sums can overflow: both counts have 32 bits.
    records = sizeof(FrozenHeader) + <uint64_t>header.frame_count * sizeof(FrozenFrame)
    records += <uint64_t>header.authority_count * sizeof(FrozenName)
    if header.index_bytes > mapping.size or header.index_bytes % LINE_BYTES or header.index_bytes < records:
        return "the size of its index does not fit"
    if frozen_checksum(header, header.index_bytes) != header.checksum:
        return "the checksum of its index is wrong"
    if header.flags & ~<uint32_t>FROZEN_LOOPED:
        return "its header has an unknown flag"
    if header.cache_time_ns < 0 or header.max_frames == 0 or header.max_bytes == 0:
        return "its cache time or limits are out of range"
    return NULL


cdef inline const FrozenFrame* _frames_of(const FrozenHeader* header) noexcept nogil:
    return <const FrozenFrame*>(header + 1)


cdef bint _is_name(const FrozenHeader* header, uint64_t start, uint32_t size) noexcept nogil:
    # Whether a text lies in the index, and may be a name.
    cdef const unsigned char* text
    if start > header.index_bytes or size > header.index_bytes - start:
        return False
    text = <const unsigned char*>header + start
    return is_utf8(text, size) and (size == 0 or memchr(text, 0, size) == NULL)


cdef const char* _frame_problem(const FrozenHeader* header, FrameId frame, uint64_t* end) noexcept nogil:
    # `end`: where the samples of the previous frame end, and then where those of this one do.
    cdef const FrozenFrame* record = _frames_of(header) + (frame - 1)
    cdef uint64_t bytes = frozen_stamp_bytes(record.count) + <uint64_t>record.count * sizeof(Sample)
    if record.name_size == 0 or not _is_name(header, record.name_start, record.name_size):
        return "its name is not a text within the index"
    if record.flags & ~FROZEN_PARENT:
        return "an unknown flag"
    if record.kind == HISTORY_NONE:
        if record.count or record.parent_changes or record.newest_ns or record.oldest_ns:
            return "samples of a frame that was never a child"
        if not record.flags & FROZEN_PARENT:
            return "a frame that no sample needs"
        return NULL
    if record.kind != HISTORY_DYNAMIC and record.kind != HISTORY_STATIC:
        return "an unknown kind"
    if record.count == 0 or record.count > LAST_CAPACITY or record.parent_changes >= record.count:
        return "its number of samples, or of changes of its parent, is out of range"
    if record.kind == HISTORY_STATIC and record.count != 1:
        return "a static frame with several samples"
    if record.authority >= header.authority_count:
        return "an authority that is not in the file"
    if record.newest_parent == 0 or record.newest_parent > header.frame_count:
        return "a parent that is not in the file"
    if record.data_start != end[0] or bytes > header.file_bytes - end[0]:
        return "its samples are not where the file has them"
    end[0] += bytes
    return NULL


cdef FrozenProblem frozen_check_index(const FileMapping* mapping) noexcept nogil:
    cdef const FrozenHeader* header = <const FrozenHeader*>mapping.start
    cdef const FrozenName* authorities
    cdef const char* text = _header_problem(mapping)
    cdef uint64_t end, i
    cdef uint64_t samples = 0
    if text != NULL:
        return _problem_of(text)
    end = header.index_bytes
    for i in range(header.frame_count):
        # Ids are smaller than a flag of the tree.
        if i == LAST_ID:
            return _problem_of("it has too many frames")
        text = _frame_problem(header, i + 1, &end)
        if text != NULL:
            return _problem_of_frame(i + 1, text)
        samples += _frames_of(header)[i].count
    if samples != header.sample_count or end != header.file_bytes:
        return _problem_of("its frames do not have the samples that it has")
    authorities = <const FrozenName*>(_frames_of(header) + header.frame_count)
    for i in range(header.authority_count):
        if not _is_name(header, authorities[i].start, authorities[i].size):
            return _problem_of("the name of an authority is not a text within the index")
    return _problem_of(NULL)


cdef const char* _read_frame(FileMapping* mapping, FrameId frame, const uint32_t* authorities,
                             Tree* tree) noexcept nogil:
    cdef const FrozenFrame* record = _frames_of(<const FrozenHeader*>mapping.start) + (frame - 1)
    cdef const char* data = <const char*>mapping.start + record.data_start
    cdef History history
    memset(&history, 0, sizeof(History))
    history.authority = NAME_UNKNOWN
    history.is_parent = record.flags & FROZEN_PARENT
    if record.kind != HISTORY_NONE:
        if history_map(&history, mapping, <const int64_t*>data,
                       <const Sample*>(data + frozen_stamp_bytes(record.count)), record.count) != 0:
            return ""
        history.kind = HISTORY_DYNAMIC if record.kind == HISTORY_DYNAMIC else HISTORY_STATIC
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
            return "its name is reserved, or that of another frame"
        if tree_add_frame(tree, name, frames[i].name_size) == NO_FRAME:
            return ""
    return NULL


cdef FrozenProblem _samples_problem(const FileMapping* mapping, const Tree* tree) noexcept nogil:
    # All that a tree has to hold, of which its memory safety depends, and that no sample has changed.
    cdef const FrozenHeader* header = <const FrozenHeader*>mapping.start
    cdef const FrozenFrame* record
    cdef FrozenProblem problem = _problem_of(NULL)
    cdef Checksum checksum
    cdef FrameId frame
    cdef uint32_t where
    for frame in range(1, header.frame_count + 1):
        record = _frames_of(header) + (frame - 1)
        problem = _problem_of_frame(frame, tree_check_frame(tree, frame, &where))
        if problem.text != NULL:
            problem.sample = where if where < record.count else UINT32_MAX
            return problem
        checksum_begin(&checksum)
        if record.count:
            checksum_add(&checksum, <const char*>header + record.data_start,
                         frozen_stamp_bytes(record.count) + record.count * sizeof(Sample))
            if checksum_end(&checksum) != record.checksum:
                return _problem_of_frame(frame, "the checksum of its samples is wrong")
    if not tree.ever_looped:
        if tree_find_loop(tree, &frame) != 0:
            return _problem_of("")
        if frame != NO_FRAME:
            return _problem_of_frame(frame, "its parents form a loop, which the header denies")
    return _problem_of(NULL)


cdef FrozenProblem frozen_read(FileMapping* mapping, bint checks_samples, Tree* tree) noexcept nogil:
    cdef const FrozenHeader* header = <const FrozenHeader*>mapping.start
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
        text = _read_frame(mapping, frame, authorities, tree)
        frame -= text == NULL
    free(authorities)
    if text != NULL:
        return _problem_of_frame(frame, text)
    tree.ever_looped = header.flags & FROZEN_LOOPED
    tree.taken = header.sample_count
    tree.is_frozen = True
    return _samples_problem(mapping, tree) if checks_samples else _problem_of(NULL)
