"""Owns what a segment tells of its owner's tree."""

from libc.stddef cimport size_t
from libc.stdint cimport uint8_t, uint32_t, uint64_t
from libc.string cimport memcpy, memset

from tf2_py._core.arena cimport arena_free, arena_init
from tf2_py._core.cache cimport Cache
from tf2_py._core.cache_memory cimport cache_change_arena, cache_free
from tf2_py._core.clock cimport sleep_ns
from tf2_py._core.names cimport Names
from tf2_py._core.segment cimport (
    AUTHORITIES_SIXTEENTH,
    LOG_ENTRIES,
    MOST_DOUBLINGS,
    NAMES_SIXTEENTH,
    RINGS_SIXTEENTH,
    ROWS_AT,
    SEGMENT_MAGIC,
    SEGMENT_VERSION,
    Facts,
    Head,
    Row,
    Segment,
    fence_full,
    fence_release,
    load32,
    segment_head,
    segment_log,
    segment_part,
    segment_rows,
    segment_word,
    store32,
    store64,
)
from tf2_py._core.tree cimport tree_relink
from tf2_py._core.types cimport NO_FRAME, FrameId, Sample

cdef enum:
    COMMIT_BYTES = 65536    # at once, of the parts that grow
    PAUSE_NS = 50000        # so long at least the owner waits for readers that it overtakes


cdef bint _commit(Segment* segment, size_t* end, size_t wanted, size_t limit) noexcept nogil:
    # Memory up to the offset `wanted`; `end`: behind what there is.
    cdef size_t more
    if wanted <= end[0]:
        return True
    if wanted > limit:
        return False
    more = min(max(wanted - end[0], <size_t>COMMIT_BYTES), limit - end[0])
    if segment.commit(segment, end[0], more) != 0:
        return False
    end[0] += more
    return True


cdef size_t _text_size(const Names* names) noexcept nogil:
    # Of all names but that with the id 0, each with its size before it.
    return names.text_size - names.names[0].size + (names.count - 1) * sizeof(uint32_t)


cdef bint _has_room(Publication* publication, size_t frames, size_t names_size,
                    size_t authorities_size) noexcept nogil:
    # For so many in all.
    cdef Segment* segment = publication.segment
    return (
        _commit(segment, &publication.rows_end, ROWS_AT + frames * sizeof(Row),
                segment_part(segment, NAMES_SIXTEENTH))
        and _commit(segment, &publication.names_end,
                    segment_part(segment, NAMES_SIXTEENTH) + names_size,
                    segment_part(segment, AUTHORITIES_SIXTEENTH))
        and _commit(segment, &publication.authorities_end,
                    segment_part(segment, AUTHORITIES_SIXTEENTH) + authorities_size,
                    segment_part(segment, RINGS_SIXTEENTH))
    )


cdef bint publication_has_room(Publication* publication, const Tree* tree,
                               const Incoming* incoming) noexcept nogil:
    return _has_room(
        publication, tree.names.count + <size_t>2,
        _text_size(&tree.names) + incoming.child_size + incoming.parent_size + 2 * sizeof(uint32_t), 0)


cdef bint publication_has_room_for(Publication* publication, size_t authority_size) noexcept nogil:
    return _has_room(publication, 0, 0,
                     publication.facts.authorities_size + authority_size + sizeof(uint32_t))


cdef int publication_begin(Publication* publication, Tree* tree, Segment* segment) noexcept nogil:
    cdef Head* head = segment_head(segment)
    publication.segment = segment
    if segment.commit(segment, 0, ROWS_AT) != 0 or arena_init(&publication.arena, segment) != 0:
        publication.segment = NULL
        return -1
    publication.rows_end = ROWS_AT
    publication.names_end = segment_part(segment, NAMES_SIXTEENTH)
    publication.authorities_end = segment_part(segment, AUTHORITIES_SIXTEENTH)
    memset(head, 0, sizeof(Head))
    head.version = SEGMENT_VERSION
    head.head_bytes = sizeof(Head)
    head.row_bytes = sizeof(Row)
    head.sample_bytes = sizeof(Sample)
    head.size = segment.size
    if not publication_adopt(publication, tree):
        return -1
    publication_open(publication)
    publication_start_over(publication)
    publication_tell_all(publication, tree)
    publication_close(publication, tree, 0)
    store64(&head.magic, SEGMENT_MAGIC)
    return 0


cdef void publication_free(Publication* publication) noexcept nogil:
    if publication.segment != NULL:
        arena_free(&publication.arena)


cdef bint publication_adopt(Publication* publication, Tree* tree) noexcept nogil:
    cdef FrameId frame
    cdef FrameId moved = 0
    if not _has_room(publication, tree.names.count, _text_size(&tree.names), _text_size(&tree.authorities)):
        return False
    while moved < tree.names.count and cache_change_arena(&tree.caches[moved], &publication.arena) == 0:
        moved += 1
    if moved == tree.names.count:
        tree.arena = &publication.arena
        return True
    for frame in range(moved):
        # Without memory for the way back the history is lost.
        if cache_change_arena(&tree.caches[frame], NULL) != 0:
            cache_free(&tree.caches[frame])
            tree.caches[frame].arena = NULL
    tree_relink(tree)
    return False


cdef void publication_start_over(Publication* publication) noexcept nogil:
    publication.facts.trees += 1
    publication.facts.frames = publication.facts.authorities = 0
    publication.facts.names_size = publication.facts.authorities_size = 0


cdef void publication_open(Publication* publication) noexcept nogil:
    publication.sequence += 1
    store64(&segment_head(publication.segment).sequence, publication.sequence)
    fence_release()


cdef void _write_row(Publication* publication, const Tree* tree, FrameId frame) noexcept nogil:
    cdef const Cache* cache = &tree.caches[frame]
    cdef Row* row = &segment_rows(publication.segment)[frame]
    row.ring = 0 if cache.ring == NULL else <uint64_t>(<char*>cache.ring - publication.segment.base)
    row.newest_ns = cache.newest_ns
    row.oldest_ns = cache.oldest_ns
    row.capacity = cache.capacity
    row.head = cache.head
    row.count = cache.count
    row.parent_changes = cache.parent_changes
    row.mostly_empty_for = cache.mostly_empty_for
    row.authority = cache.authority
    row.parent = tree.parents[frame]
    row.appended = cache.appended
    row.disturbed = cache.disturbed
    row.kind = <uint8_t>cache.kind
    row.is_parent = <uint8_t>cache.is_parent


cdef inline void _log(Publication* publication, FrameId frame) noexcept nogil:
    segment_log(publication.segment)[publication.facts.logged % LOG_ENTRIES] = frame
    publication.facts.logged += 1


cdef void publication_tell(Publication* publication, const Tree* tree, const Change* change) noexcept nogil:
    # New frames are told with the others, at the end.
    if change.frame == NO_FRAME or publication.facts.frames == 0:
        return
    if change.frame < publication.facts.frames:
        _write_row(publication, tree, change.frame)
        _log(publication, change.frame)
    if change.parent < publication.facts.frames and not segment_rows(
            publication.segment)[change.parent].is_parent:
        _write_row(publication, tree, change.parent)
        _log(publication, change.parent)


cdef void publication_tell_all(Publication* publication, const Tree* tree) noexcept nogil:
    cdef FrameId frame
    for frame in range(publication.facts.frames):
        _write_row(publication, tree, frame)
    # Whoever is so far behind reads all of them.
    publication.facts.logged += max(<uint64_t>LOG_ENTRIES, <uint64_t>tree.names.count)


cdef size_t _write_names(char* text, const Names* names, uint32_t first) noexcept nogil:
    # From this id on; the bytes written. Both sides have the one with the id 0.
    cdef char* out = text
    cdef uint32_t id
    for id in range(max(first, <uint32_t>1), names.count):
        memcpy(out, &names.names[id].size, sizeof(uint32_t))
        out += sizeof(uint32_t)
        memcpy(out, names.text + names.names[id].start, names.names[id].size)
        out += names.names[id].size
    return <size_t>(out - text)


cdef void publication_close(Publication* publication, const Tree* tree,
                            unsigned long long malformed) noexcept nogil:
    cdef Segment* segment = publication.segment
    cdef Facts* facts = &publication.facts
    cdef FrameId frame
    cdef bint somebody_waits = load32(&segment.board.somebody_waits)
    # Before anybody can see the new sequence: a reader that has, and waits for the next one, says so again.
    if somebody_waits:
        store32(&segment.board.somebody_waits, 0)
    if facts.frames < tree.names.count:
        facts.names_size += _write_names(
            segment.base + segment_part(segment, NAMES_SIXTEENTH) + facts.names_size, &tree.names,
            facts.frames)
        for frame in range(facts.frames, tree.names.count):
            _write_row(publication, tree, frame)
        facts.frames = tree.names.count
    if facts.authorities < tree.authorities.count:
        facts.authorities_size += _write_names(
            segment.base + segment_part(segment, AUTHORITIES_SIXTEENTH) + facts.authorities_size,
            &tree.authorities, facts.authorities)
        facts.authorities = tree.authorities.count
    facts.ever_looped = tree.ever_looped
    facts.cache_time_ns = tree.cache_time_ns
    facts.bytes = tree.history_bytes
    facts.taken = tree.taken
    memcpy(facts.refused, tree.refused, sizeof(tree.refused))
    facts.malformed = malformed
    segment_head(segment).facts = facts[0]
    publication.sequence += 1
    store64(&segment_head(segment).sequence, publication.sequence)
    # Between this and the question a reader may say that it waits: then it sees the new sequence.
    fence_full()
    if somebody_waits or load32(&segment.board.somebody_waits):
        segment.wake(segment_word(segment))


cdef void publication_pause(Publication* publication) noexcept nogil:
    cdef uint32_t wish = load32(&publication.segment.board.somebody_is_late)
    if wish:
        store32(&publication.segment.board.somebody_is_late, 0)
        sleep_ns(PAUSE_NS << min(wish - 1, <uint32_t>MOST_DOUBLINGS))
