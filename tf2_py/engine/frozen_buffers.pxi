# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Write a tree to a frozen file or to an image, which has the same bytes, and make a tree of either."""

# Only the engine calls write_frozen, read_frozen and read_image. `names` and `authorities`: those of the tree
# that are known so far.

cdef enum:
    WRITTEN_LINES = 16384       # at once: 1 MiB
    STAMPS_PER_LINE = 8


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
    # With all but its name; it has samples.
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


cdef object _samples_checksum(const FrozenHeader* header):
    # Of all lines behind a whole index.
    cdef char* lines = <char*>header + header.index_bytes
    return zlib.crc32(PyMemoryView_FromMemory(lines, header.file_bytes - header.index_bytes, PyBUF_READ))


cdef object _index_checksum(const FrozenHeader* header):
    # Of a whole index, with 0 in place of the checksum itself.
    index = PyMemoryView_FromMemory(<char*>header, header.index_bytes, PyBUF_READ)
    start = <char*>&header.checksum - <char*>header
    before = zlib.crc32(bytes(sizeof(header.checksum)), zlib.crc32(index[:start]))
    return zlib.crc32(index[start + sizeof(header.checksum):], before)


cdef struct Place:
    # Among the lines behind the index.
    FrameId frame               # by its id in the tree
    size_t line                 # of those of the frame


cdef size_t _copy_lines(const Tree* view, const FrameId* ids, Place* next, char* lines,
                        size_t count) noexcept nogil:
    # Copies up to `count` lines from there on, and returns how many there were.
    cdef const History* history
    cdef char* start
    cdef size_t stamp_lines, size, first, i
    cdef size_t done = 0
    while next.frame < view.names.count and done < count:
        start = lines + done * LINE_BYTES
        history = &view.histories[next.frame]
        stamp_lines = frozen_stamp_bytes(history.count) // LINE_BYTES
        if next.line < stamp_lines:
            size = min(stamp_lines - next.line, count - done)
            first = next.line * STAMPS_PER_LINE
            memset(start + (size - 1) * LINE_BYTES, 0, LINE_BYTES)
            history_copy_stamps(history, first, min(history.count - first, size * STAMPS_PER_LINE),
                                <int64_t*>start)
        elif next.line < stamp_lines + history.count:
            first = next.line - stamp_lines
            size = min(history.count - first, count - done)
            history_copy_samples(history, first, size, <Sample*>start)
            for i in range(size):
                (<Sample*>start)[i].parent = ids[(<Sample*>start)[i].parent]
        else:
            next.frame += 1
            next.line = 0
            continue
        next.line += size
        done += size
    return done


cdef int _write_file(const Tree* view, const FrameId* ids, bytearray index, file) except -1:
    cdef FrozenHeader* header = <FrozenHeader*>PyByteArray_AS_STRING(index)
    cdef size_t count
    cdef Place next
    cdef char* lines = <char*>malloc(WRITTEN_LINES * LINE_BYTES)
    next.frame = next.line = 0
    if lines == NULL:
        raise MemoryError
    try:
        # The checksum of the samples is only known when they are written.
        file.write(index)
        checksum = 0
        while True:
            with nogil:
                count = _copy_lines(view, ids, &next, lines, WRITTEN_LINES)
            if count == 0:
                break
            data = PyMemoryView_FromMemory(lines, count * LINE_BYTES, PyBUF_READ)
            file.write(data)
            checksum = zlib.crc32(data, checksum)
        header.samples_checksum = checksum
        header.checksum = _index_checksum(header)
        file.seek(0)
        file.write(index)
    finally:
        free(lines)
    return 0


cdef bytes _image(const Tree* view, const FrameId* ids, bytearray index):
    cdef uint64_t index_bytes = len(index)
    cdef FrozenHeader* header = <FrozenHeader*>PyByteArray_AS_STRING(index)
    cdef bytes image = PyBytes_FromStringAndSize(NULL, header.file_bytes)
    cdef Place next
    next.frame = next.line = 0
    memcpy(PyBytes_AS_STRING(image), header, index_bytes)
    header = <FrozenHeader*>PyBytes_AS_STRING(image)
    with nogil:
        _copy_lines(view, ids, &next, <char*>header + index_bytes,
                    (header.file_bytes - index_bytes) // LINE_BYTES)
    header.samples_checksum = _samples_checksum(header)
    header.checksum = _index_checksum(header)
    return image


cdef bytes write_frozen(const Tree* tree, Lock* lock, file, list names, list authorities):
    # Writes the content of a tree at one moment to a binary file that is at its beginning and can seek. None:
    # returns it as an image.
    cdef Tree view
    cdef NumberedFrames frames
    cdef bytearray index
    memset(&frames, 0, sizeof(NumberedFrames))
    pin_tree(tree, lock, &view)
    try:
        learn_names(&tree.names, lock, names)
        learn_names(&tree.authorities, lock, authorities)
        frames.ids = <FrameId*>calloc(view.names.count, sizeof(FrameId))
        frames.is_parent = <unsigned char*>calloc(view.names.count, 1)
        if frames.ids == NULL or frames.is_parent == NULL:
            raise MemoryError
        with nogil:
            _number_frames(&view, &frames)
        index = _index_of(&view, &frames, names, authorities)
        if file is None:
            return _image(&view, frames.ids, index)
        _write_file(&view, frames.ids, index, file)
    finally:
        free(frames.ids)
        free(frames.is_parent)
        with nogil:
            unpin_tree(&view)


# Reading. `path`: of a file; None: it is an image.

cdef object _damaged(str path, str problem):
    if path is None:
        return ValueError(f"the state of the buffer is damaged: {problem}; pickle the buffer again")
    return ValueError(f"{printable(path)}: it is damaged: {problem}; freeze the buffer again")


cdef int _require_sound(str path, const FrozenHeader* header, FrozenProblem problem) except -1:
    cdef const FrozenFrame* record
    if problem.text == NULL:
        return 0
    if problem.text[0] == 0:
        raise MemoryError
    where = ""
    if problem.frame != NO_FRAME:
        record = <const FrozenFrame*>(header + 1) + (problem.frame - 1)
        where = f"frame {problem.frame}"
        if record.name_start <= header.index_bytes \
                and record.name_size <= header.index_bytes - record.name_start:
            name = (<const char*>header)[record.name_start:record.name_start + record.name_size]
            where += f", {printable(name.decode('utf-8', 'replace'))}"
        where += ": "
    if problem.sample != UINT32_MAX:
        where += f"sample {problem.sample}: "
    raise _damaged(path, where + problem.text.decode())


cdef int _require_index(str path, const FrozenHeader* header, size_t file_bytes) except -1:
    cdef FrozenProblem problem
    with nogil:
        problem = frozen_check_index(header, file_bytes)
    _require_sound(path, header, problem)
    if header.checksum != _index_checksum(header):
        raise _damaged(path, "the checksum of its index is wrong")
    return 0


cdef int _read_tree(str path, const FrozenHeader* header, FileMapping* mapping, bint checks_samples,
                    Tree* tree) except -1:
    # As frozen_read, and with the checksum of the samples. If it raises, there is no tree.
    cdef FrozenProblem problem
    with nogil:
        problem = frozen_read(header, mapping, checks_samples, tree)
    try:
        _require_sound(path, header, problem)
        # After all else, because other errors name the frame and the sample.
        if checks_samples and header.samples_checksum != _samples_checksum(header):
            raise _damaged(path, "the checksum of its samples is wrong")
    except BaseException:
        with nogil:
            tree_free(tree)
        raise
    return 0


cdef int read_image(image, Tree* tree) except -1:
    # Makes a tree from bytes. ValueError: they are not an image, or it is damaged. If it raises, there is no
    # tree.
    cdef bytes data = unchanging_bytes(image)
    cdef size_t size = PyBytes_GET_SIZE(data)
    cdef const FrozenHeader* header = <const FrozenHeader*>PyBytes_AS_STRING(data)
    if size < sizeof(FrozenHeader) or frozen_check_format(header, size) != NULL:
        raise ValueError("this is not the state of a buffer, or another version of tf2-ros-cython wrote it: "
                         "pickle the buffer again with this one")
    _require_index(None, header, size)
    return _read_tree(None, header, NULL, True, tree)


cdef int _require_header(int descriptor, size_t file_bytes, str path) except -1:
    # So that nothing is mapped, and no memory allocated, for a file that is something else.
    cdef FrozenHeader header
    cdef const char* text
    cdef size_t size = min(file_bytes, sizeof(FrozenHeader))
    cdef bytes data = os.pread(descriptor, size, 0)
    if <size_t>len(data) < size:
        raise ValueError(f"{printable(path)}: its size changed while it was being read: try again")
    memset(&header, 0, sizeof(FrozenHeader))
    memcpy(&header, PyBytes_AS_STRING(data), size)
    text = frozen_check_format(&header, file_bytes)
    if text != NULL:
        raise ValueError(f"{printable(path)}: {text.decode()}")
    text = frozen_check_header(&header, file_bytes)
    if text != NULL:
        raise _damaged(path, text.decode())
    return 0


cdef FileMapping* _map(int descriptor, size_t size, str path) except NULL:
    cdef FileMapping* mapping = <FileMapping*>calloc(1, sizeof(FileMapping))
    cdef int problem
    if mapping == NULL:
        raise MemoryError
    mapping.size = size
    mapping.owners = 1
    mapping.start = mmap(NULL, size, PROT_READ, MAP_SHARED, descriptor, 0)
    if mapping.start == MAP_FAILED:
        problem = errno
        free(mapping)
        if problem == ENOMEM:
            raise MemoryError
        raise OSError(problem, os.strerror(problem), path)
    return mapping


cdef object read_frozen(path, expected, Tree* tree):
    # Makes a tree from a file, and returns the frozen_file.FrozenFile. `expected`: that from which a pickled
    # buffer was opened, whose samples are not checked again; or None. ValueError: it is not a frozen file, is
    # damaged, or another one is expected; OSError: it cannot be opened. If it raises, there is no tree.
    cdef FileMapping* mapping
    cdef const FrozenHeader* header
    cdef bint checks_samples
    cdef str name = os.path.abspath(os.fsdecode(path))
    cdef int descriptor = os.open(name if path else path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    try:
        facts = os.fstat(descriptor)
        if not S_ISREG(facts.st_mode):
            raise ValueError(f"{printable(name)}: it is not a frozen buffer written by Buffer.freeze")
        _require_header(descriptor, facts.st_size, name)
        mapping = _map(descriptor, facts.st_size, name)
    finally:
        os.close(descriptor)
    checks_samples = (expected is None or facts.st_size != expected.size
                      or facts.st_mtime_ns != expected.modified_ns)
    header = <const FrozenHeader*>mapping.start
    try:
        _require_index(name, header, mapping.size)
        found = frozen_file.FrozenFile(
            name, header.checksum, facts.st_size, facts.st_mtime_ns, facts.st_dev, facts.st_ino
        )
        if expected is not None and found.checksum != expected.checksum:
            text = "it has changed since the buffer was pickled or copied"
            raise ValueError(f"{printable(name)}: {text}")
        _read_tree(name, header, mapping, checks_samples, tree)
        if checks_samples:
            # What the checks have read need not stay in the process: lookups map what they read anew.
            madvise(mapping.start, mapping.size, MADV_DONTNEED)
        return found
    finally:
        mapping_release(mapping)
