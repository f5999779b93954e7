"""Write a tree to a frozen file, and make a tree of one that is mapped."""

cdef enum:
    CHUNK_SAMPLES = 16384       # written at once: 1 MiB


# Writing.

cdef struct NumberedFrames:
    # The frames that a file has, and the ids that they have there.
    FrameId* ids                # by the id in the tree; NO_FRAME: it is not in the file
    unsigned char* is_parent    # likewise
    uint32_t count              # of those in the file


cdef void _number_frames(const Tree* view, NumberedFrames* frames) noexcept nogil:
    # Only frames that samples need, in the order of their ids.
    cdef const History* history
    cdef FrameId id
    cdef uint32_t i
    for id in range(1, view.names.count):
        history = &view.histories[id]
        for i in range(history.count if history.parent_changes else min(history.count, <uint32_t>1)):
            frames.is_parent[history_parent_of(history, i)] = 1
    frames.count = 0
    for id in range(1, view.names.count):
        if view.histories[id].count or frames.is_parent[id]:
            frames.count += 1
            frames.ids[id] = frames.count


cdef void _fill_frame(FrozenFrame* record, const History* history, uint32_t authority, const FrameId* ids,
                      uint64_t* data_end) noexcept nogil:
    # With all but its name and the checksum of its samples.
    if history.count == 0:
        return
    record.kind = history.kind
    record.authority = authority
    record.newest_parent = ids[history_newest_parent(history)]
    record.count = history.count
    record.parent_changes = history.parent_changes
    record.oldest_ns = history.oldest_ns
    record.newest_ns = history.newest_ns
    record.data_start = data_end[0]
    data_end[0] += frozen_stamp_bytes(history.count) + <uint64_t>history.count * sizeof(Sample)


cdef bytearray _index_of(const Tree* view, const NumberedFrames* frames, list names, list authorities):
    # All of it except for the checksums.
    cdef FrozenHeader* header
    cdef FrozenFrame* record
    cdef FrozenName* sender
    cdef FrameId id
    cdef uint64_t start, data_end
    cdef dict senders = {}
    cdef list texts = [names[id].encode() for id in range(1, view.names.count) if frames.ids[id]]
    for id in range(1, view.names.count):
        if view.histories[id].count:
            senders.setdefault(name_of(authorities, view.histories[id].authority), len(senders))
    texts += [one.encode() for one in senders]
    start = sizeof(FrozenHeader) + frames.count * sizeof(FrozenFrame) + len(senders) * sizeof(FrozenName)
    text = b"".join(texts)
    data_end = (start + <uint64_t>len(text) + LINE_BYTES - 1) // LINE_BYTES * LINE_BYTES
    index = bytearray(data_end)
    index[start:start + <uint64_t>len(text)] = text
    header = <FrozenHeader*>PyByteArray_AS_STRING(index)
    frozen_header_begin(header)
    header.flags = FROZEN_LOOPED if view.ever_looped else 0
    header.index_bytes = data_end
    header.cache_time_ns = view.retention.cache_time_ns
    header.max_bytes = view.limits.bytes
    header.max_frames = view.limits.frames
    header.frame_count = frames.count
    header.authority_count = len(senders)
    header.sample_count = view.samples
    record = <FrozenFrame*>(header + 1)
    sender = <FrozenName*>(record + frames.count)
    for id in range(1, view.names.count):
        if frames.ids[id] == NO_FRAME:
            continue
        record.name_start = start
        record.name_size = len(texts[frames.ids[id] - 1])
        record.flags = FROZEN_PARENT if frames.is_parent[id] else 0
        start += record.name_size
        if view.histories[id].count:
            _fill_frame(record, &view.histories[id],
                        senders[name_of(authorities, view.histories[id].authority)], frames.ids, &data_end)
        record += 1
    for one in texts[frames.count:]:
        sender.start = start
        sender.size = len(one)
        start += sender.size
        sender += 1
    header.file_bytes = data_end
    return index


cdef int _write_samples(const History* history, const FrameId* ids, char* chunk, file,
                        uint64_t* sum_of_samples) except -1:
    # `chunk` has room for CHUNK_SAMPLES samples.
    cdef Checksum checksum
    cdef uint32_t first, count
    cdef size_t size
    checksum_begin(&checksum)
    for first in range(0, history.count, CHUNK_SAMPLES):
        count = min(history.count - first, <uint32_t>CHUNK_SAMPLES)
        size = frozen_stamp_bytes(count)
        with nogil:
            memset(chunk, 0, size)
            history_copy_stamps(history, first, count, <int64_t*>chunk)
            checksum_add(&checksum, chunk, size)
        file.write(PyMemoryView_FromMemory(chunk, size, PyBUF_READ))
    for first in range(0, history.count, CHUNK_SAMPLES):
        count = min(history.count - first, <uint32_t>CHUNK_SAMPLES)
        size = count * sizeof(Sample)
        with nogil:
            history_copy_samples(history, first, count, ids, <Sample*>chunk)
            checksum_add(&checksum, chunk, size)
        file.write(PyMemoryView_FromMemory(chunk, size, PyBUF_READ))
    sum_of_samples[0] = checksum_end(&checksum)
    return 0


cdef int _write(const Tree* view, const NumberedFrames* frames, char* chunk, file, list names,
                list authorities) except -1:
    cdef bytearray index = _index_of(view, frames, names, authorities)
    cdef FrozenHeader* header = <FrozenHeader*>PyByteArray_AS_STRING(index)
    cdef FrozenFrame* records = <FrozenFrame*>(header + 1)
    cdef FrameId id
    # The samples' checksums are only known when they are written.
    file.write(index)
    for id in range(1, view.names.count):
        if view.histories[id].count:
            _write_samples(&view.histories[id], frames.ids, chunk, file,
                           &records[frames.ids[id] - 1].checksum)
    header.checksum = frozen_checksum(header, header.index_bytes)
    file.seek(0)
    file.write(index)
    return 0


cdef int write_frozen(const Tree* tree, Lock* lock, file, list names, list authorities) except -1:
    cdef Tree view
    cdef NumberedFrames frames
    cdef char* chunk = NULL
    memset(&frames, 0, sizeof(NumberedFrames))
    _pin_all(tree, lock, &view)
    try:
        learn_names(&tree.names, lock, names)
        learn_names(&tree.authorities, lock, authorities)
        frames.ids = <FrameId*>calloc(view.names.count, sizeof(FrameId))
        frames.is_parent = <unsigned char*>calloc(view.names.count, 1)
        chunk = <char*>malloc(CHUNK_SAMPLES * sizeof(Sample))
        if frames.ids == NULL or frames.is_parent == NULL or chunk == NULL:
            raise MemoryError
        with nogil:
            _number_frames(&view, &frames)
        _write(&view, &frames, chunk, file, names, authorities)
    finally:
        free(frames.ids)
        free(frames.is_parent)
        free(chunk)
        with nogil:
            _unpin_all(&view)
    return 0


# Mapping.

cdef int _fill_copy(int descriptor, FileMapping* mapping) noexcept nogil:
    # Reads the file into the memory of a mapping. 0, or the number of an error; EIO: the file has shrunk.
    cdef size_t done = 0
    cdef ssize_t count
    while done < mapping.size:
        count = pread(descriptor, <char*>mapping.start + done, mapping.size - done, done)
        if count == 0:
            return EIO
        if count < 0 and errno != EINTR:
            return errno
        done += max(count, <ssize_t>0)
    return errno if mprotect(mapping.start, mapping.size, PROT_READ) else 0


cdef FileMapping* _map(int descriptor, size_t size, bint is_copy, str path) except NULL:
    cdef FileMapping* mapping = <FileMapping*>calloc(1, sizeof(FileMapping))
    cdef int problem = 0
    if mapping == NULL:
        raise MemoryError
    mapping.size = size
    mapping.owners = 1
    mapping.is_copy = is_copy
    if is_copy:
        mapping.start = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0)
    else:
        mapping.start = mmap(NULL, size, PROT_READ, MAP_SHARED, descriptor, 0)
    if mapping.start == MAP_FAILED:
        problem = errno
        free(mapping)
    elif is_copy:
        with nogil:
            problem = _fill_copy(descriptor, mapping)
        if problem:
            mapping_release(mapping)
    if problem == ENOMEM:
        raise MemoryError
    if problem:
        raise OSError(problem, os.strerror(problem), path)
    return mapping


cdef object _frozen_error(str path, const FileMapping* mapping, FrozenProblem problem):
    cdef const FrozenHeader* header = <const FrozenHeader*>mapping.start
    cdef const FrozenFrame* record
    if problem.text[0] == 0:
        return MemoryError()
    where = printable(path)
    if problem.frame != NO_FRAME:
        record = <const FrozenFrame*>(header + 1) + (problem.frame - 1)
        where += f": frame {problem.frame}"
        if record.name_start <= header.index_bytes \
                and record.name_size <= header.index_bytes - record.name_start:
            name = (<const char*>header)[record.name_start:record.name_start + record.name_size]
            where += f", {printable(name.decode('utf-8', 'replace'))}"
    if problem.sample != UINT32_MAX:
        where += f": sample {problem.sample}"
    return ValueError(f"{where}: {problem.text.decode()}")


cdef object read_frozen(path, bint is_copy, expected, Tree* tree):
    cdef FileMapping* mapping
    cdef FrozenProblem problem
    cdef bint checks_samples
    cdef str name = os.path.abspath(os.fsdecode(path))
    cdef int descriptor = os.open(name, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    try:
        facts = os.fstat(descriptor)
        if not S_ISREG(facts.st_mode) or facts.st_size == 0:
            raise ValueError(f"{printable(name)}: it is not a frozen buffer")
        mapping = _map(descriptor, facts.st_size, is_copy, name)
    finally:
        os.close(descriptor)
    checks_samples = (expected is None or facts.st_size != expected.size
                      or facts.st_mtime_ns != expected.modified_ns)
    try:
        with nogil:
            problem = frozen_check_index(mapping)
        if problem.text != NULL:
            raise _frozen_error(name, mapping, problem)
        found = frozen_file.FrozenFile(
            name, (<const FrozenHeader*>mapping.start).checksum, facts.st_size, facts.st_mtime_ns,
            facts.st_dev, facts.st_ino,
        )
        if expected is not None and found.checksum != expected.checksum:
            raise ValueError(f"{printable(name)}: it is not the file of the buffer that was pickled")
        with nogil:
            problem = frozen_read(mapping, checks_samples, tree)
        if problem.text != NULL:
            error = _frozen_error(name, mapping, problem)
            tree_free(tree)
            raise error
        return None if is_copy else found
    finally:
        mapping_release(mapping)
