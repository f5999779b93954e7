"""Owns following the tree of another process: what is copied of it, checked, and told to waiters."""

from libc.stddef cimport size_t
from libc.stdint cimport INT64_MAX, INT64_MIN, SIZE_MAX, int64_t, uint32_t, uint64_t
from libc.stdlib cimport free, realloc
from libc.string cimport memcpy, memset

from tf2_py._core.cache cimport CACHE_NONE, CACHE_STATIC, Cache, CacheKind
from tf2_py._core.cache_insert cimport cache_mend
from tf2_py._core.cache_memory cimport (
    CACHE_INSERTED,
    LAST_CAPACITY,
    cache_free,
    cache_move,
    cache_read_from,
    cache_ring_bytes,
)
from tf2_py._core.change cimport (
    ANY_TIME,
    CHANGE_DATA,
    CHANGE_PARENT,
    Change,
    change_add,
    change_begin,
)
from tf2_py._core.clock cimport monotonic_ns, sleep_ns
from tf2_py._core.lock cimport _pause
from tf2_py._core.names cimport NAME_UNKNOWN, names_find, names_intern
from tf2_py._core.segment cimport (
    AUTHORITIES_SIXTEENTH,
    LEAST_SIXTEENTH,
    LOG_ENTRIES,
    NAMES_SIXTEENTH,
    RINGS_SIXTEENTH,
    SEGMENT_MAGIC,
    SEGMENT_VERSION,
    Facts,
    Head,
    Row,
    Segment,
    fence_acquire,
    load64,
    segment_ask_for_pause,
    segment_head,
    segment_log,
    segment_most_rows,
    segment_part,
    segment_rows,
)
from tf2_py._core.mirror_state cimport Mirror, NumberedRow
from tf2_py._core.tree cimport Limits, Tree, tree_add_frame, tree_free, tree_init, tree_relink
from tf2_py._core.types cimport LINE_BYTES, MIXED_PARENTS, NO_FRAME, FrameId, Sample
from tf2_py._core.utf8 cimport is_utf8

cdef enum:
    SPINS = 64              # tries without a sleep
    NAP_NS = 20000          # then between two tries
    TRIES_PER_DOUBLING = 8  # of the pause that the owner is asked for
    NAPS_PER_LOOK = 16      # naps after which it is looked whether the owner lives
    MOST_CHANGES = 1024     # collected one by one
    SHORTEST_NAME = 5       # bytes of the name of a frame in a segment: its size, and a byte
    COPIES = 50             # of one history, before what is copied is mended

# An owner that has been at one write for so long has been stopped in the middle of it.
cdef int64_t STUCK_NS = 300 * <int64_t>1000000

cdef enum Try:
    CAUGHT_UP
    OVERTAKEN               # the owner was writing
    BROKEN                  # see Mirror.problem


cdef const char* segment_problem(const Segment* segment) noexcept nogil:
    cdef const Head* head = segment_head(segment)
    if segment.size // 16 < LEAST_SIXTEENTH or head.magic != SEGMENT_MAGIC:
        return "it is no shared buffer"
    if head.version != SEGMENT_VERSION:
        return "it is of another version of this package"
    if (head.head_bytes != sizeof(Head) or head.row_bytes != sizeof(Row)
            or head.sample_bytes != sizeof(Sample)):
        return "it is of another layout of this package"
    if head.size != segment.size:
        return "it was truncated"
    return NULL


cdef void mirror_begin(Tree* tree, Mirror* mirror, Segment* segment) noexcept nogil:
    mirror.segment = segment
    mirror.own_cache_time_ns = tree.cache_time_ns
    mirror.sequence = 1         # no sequence of a tree at rest
    tree.mirror = mirror


cdef void mirror_free(Mirror* mirror) noexcept nogil:
    free(mirror.changes)
    free(mirror.rows)
    free(mirror.text)


cdef void _collect(Mirror* mirror, const Change* change) noexcept nogil:
    cdef uint32_t capacity
    cdef void* grown
    if not mirror.collects or mirror.everything or change.count == 0:
        return
    mirror.everything = mirror.change_count == MOST_CHANGES
    if not mirror.everything and mirror.change_count == mirror.change_capacity:
        capacity = mirror.change_capacity * 2 if mirror.change_capacity else 16
        grown = realloc(mirror.changes, capacity * sizeof(Change))
        mirror.everything = grown == NULL
        if grown != NULL:
            mirror.changes = <Change*>grown
            mirror.change_capacity = capacity
    if not mirror.everything:
        mirror.changes[mirror.change_count] = change[0]
        mirror.change_count += 1


cdef void _collect_everything(Mirror* mirror) noexcept nogil:
    mirror.everything = mirror.everything or mirror.collects


cdef void _collect_row(Tree* tree, FrameId frame, const Row* row) noexcept nogil:
    # Before it is applied. Ranges may be larger than the change: a lookup is then tried in vain.
    cdef const Cache* old = &tree.caches[frame]
    cdef uint32_t old_parent = tree.parents[frame]
    cdef Change change
    change_begin(&change)
    change.frame = frame
    if row.disturbed == old.disturbed and row.appended == old.appended and row.count == old.count:
        return
    if (row.disturbed == old.disturbed and old.count and not (old_parent | row.parent) & MIXED_PARENTS
            and row.parent == old_parent and not tree.ever_looped):
        change_add(&change, CHANGE_DATA, old.newest_ns, row.newest_ns)
        if old.newest_ns == 0:
            change_add(&change, CHANGE_PARENT, ANY_TIME, ANY_TIME)
    else:
        change_add(&change, CHANGE_DATA, INT64_MIN, INT64_MAX)
        change_add(&change, CHANGE_PARENT, INT64_MIN, INT64_MAX)
    _collect(tree.mirror, &change)


cdef const char* _row_problem(const Tree* tree, const Row* row) noexcept nogil:
    cdef const Segment* segment = tree.mirror.segment
    if row.kind > CACHE_STATIC or row.is_parent > 1:
        return "it holds a frame of a kind that there is not"
    if (row.parent & ~<uint32_t>MIXED_PARENTS) >= tree.names.count:
        return "it holds a parent that is no frame"
    if row.authority != NAME_UNKNOWN and row.authority >= tree.authorities.count:
        return "it holds an authority that is no name"
    if row.capacity == 0:
        if row.count:
            return "it holds samples without memory"
        return NULL
    if (row.capacity > LAST_CAPACITY or row.head >= row.capacity or row.count > row.capacity
            or row.kind == CACHE_NONE or row.ring % LINE_BYTES
            or row.ring < segment_part(segment, RINGS_SIXTEENTH) or row.ring > segment.size
            or cache_ring_bytes(row.capacity) > segment.size - row.ring):
        return "it holds a history beyond its memory"
    if row.oldest_ns > row.newest_ns:
        return "it holds a history that ends before it begins"
    return NULL


cdef void _apply_row(Tree* tree, FrameId frame, const Row* row) noexcept nogil:
    cdef Cache* cache = &tree.caches[frame]
    tree.samples += row.count - <uint64_t>cache.count
    memset(cache, 0, sizeof(Cache))
    if row.capacity:
        cache_read_from(cache, tree.mirror.segment.base + row.ring, row.capacity)
    cache.head = row.head
    cache.count = row.count
    cache.parent_changes = row.parent_changes
    cache.mostly_empty_for = row.mostly_empty_for
    cache.kind = <CacheKind>row.kind
    cache.newest_ns = row.newest_ns
    cache.oldest_ns = row.oldest_ns
    cache.authority = row.authority
    cache.is_parent = row.is_parent
    cache.appended = row.appended
    cache.disturbed = row.disturbed
    tree.parents[frame] = row.parent


cdef const char* _facts_problem(const Tree* tree, const Facts* facts) noexcept nogil:
    cdef const Segment* segment = tree.mirror.segment
    cdef size_t room = segment_part(segment, 1)
    if facts.frames == 0 or facts.frames > segment_most_rows(segment) or facts.cache_time_ns < 0:
        return "it tells of more frames than it has room for"
    # Before memory is taken for their rows, and read for them that the owner never wrote.
    if (facts.frames - 1) * <uint64_t>SHORTEST_NAME > facts.names_size:
        return "it tells of more frames than names"
    if facts.names_size > room or facts.authorities_size > room or facts.authorities == 0:
        return "it tells of more names than it has room for"
    if facts.trees == tree.mirror.trees and (
            facts.names_size < tree.mirror.names_size or facts.frames < tree.names.count
            or facts.authorities_size < tree.mirror.authorities_size
            or facts.authorities < tree.authorities.count):
        return "names have vanished from it"
    return NULL


cdef bint _reserve(Mirror* mirror, size_t rows, size_t text) noexcept nogil:
    cdef void* grown
    if rows > mirror.rows_capacity:
        grown = realloc(mirror.rows, rows * sizeof(NumberedRow))
        if grown == NULL:
            return False
        mirror.rows = <NumberedRow*>grown
        mirror.rows_capacity = rows
    if text > mirror.text_capacity:
        grown = realloc(mirror.text, text)
        if grown == NULL:
            return False
        mirror.text = <char*>grown
        mirror.text_capacity = text
    return True


cdef inline void _read_row(Mirror* mirror, FrameId frame, uint32_t* count) noexcept nogil:
    mirror.rows[count[0]].frame = frame
    mirror.rows[count[0]].row = segment_rows(mirror.segment)[frame]
    count[0] += 1


cdef uint32_t _read_rows(const Tree* tree, const Facts* facts, uint32_t known) noexcept nogil:
    # Those that changed, and the new ones; how many. `known`: how many frames the tree knows of this one.
    cdef Mirror* mirror = tree.mirror
    cdef const uint32_t* log = segment_log(mirror.segment)
    cdef uint64_t changes = facts.logged - mirror.logged
    cdef uint64_t i
    cdef uint32_t count = 0
    cdef uint32_t frame
    if changes >= min(<uint64_t>known, <uint64_t>LOG_ENTRIES):
        # The log is too long, or has been written over: all of them.
        known = 0
    else:
        for i in range(mirror.logged, facts.logged):
            frame = log[i % LOG_ENTRIES]
            if frame < known:
                _read_row(mirror, frame, &count)
    for frame in range(known, facts.frames):
        _read_row(mirror, frame, &count)
    return count


cdef const char* _next_name(const char** text, size_t* left, uint32_t* size) noexcept nogil:
    # Moves `text` to a name. NULL, or why there is none.
    if left[0] < sizeof(uint32_t):
        return "a name in it is cut off"
    memcpy(size, text[0], sizeof(uint32_t))
    text[0] += sizeof(uint32_t)
    left[0] -= sizeof(uint32_t)
    if size[0] > left[0]:
        return "a name in it is cut off"
    # Python would refuse anything else when the name is shown.
    if not is_utf8(<const unsigned char*>text[0], size[0]):
        return "a name in it is no UTF-8"
    return NULL


cdef const char* _apply_names(Tree* tree, const Facts* facts, const char* text, size_t left) noexcept nogil:
    cdef Change change
    cdef uint32_t size
    cdef uint32_t refused = 0
    cdef const char* problem
    while tree.names.count < facts.frames:
        problem = _next_name(&text, &left, &size)
        if problem != NULL:
            return problem
        if names_find(&tree.names, text, size) != NAME_UNKNOWN:
            return "a name in it occurs twice"
        change_begin(&change)
        if tree_add_frame(tree, text, size, &change, &refused) == NO_FRAME:
            return "there is no memory for its names"
        _collect(tree.mirror, &change)
        text += size
        left -= size
    if left:
        return "it holds more names than frames"
    return NULL


cdef const char* _apply_authorities(Tree* tree, const Facts* facts, const char* text,
                                    size_t left) noexcept nogil:
    cdef uint32_t size, known
    cdef const char* problem
    while tree.authorities.count < facts.authorities:
        problem = _next_name(&text, &left, &size)
        if problem != NULL:
            return problem
        known = tree.authorities.count
        if names_intern(&tree.authorities, text, size) != known:
            return "there is no memory for its authorities, or one occurs twice"
        text += size
        left -= size
    if left:
        return "it holds more authorities than it says"
    return NULL


cdef const char* _start_over(Tree* tree) noexcept nogil:
    # The owner has another tree: with other ids.
    cdef Mirror* mirror = tree.mirror
    cdef Limits limits = tree.limits
    tree_free(tree)
    memset(tree, 0, sizeof(Tree))
    tree.mirror = mirror
    _collect_everything(mirror)
    if tree_init(tree, mirror.own_cache_time_ns, &limits) != 0:
        return "there is no memory for its names"
    return NULL


cdef const char* _apply(Tree* tree, const Facts* facts, uint32_t rows, size_t names_size) noexcept nogil:
    cdef Mirror* mirror = tree.mirror
    cdef const char* problem = NULL
    cdef uint32_t i
    if facts.trees != mirror.trees:
        problem = _start_over(tree)
    if problem == NULL:
        problem = _apply_names(tree, facts, mirror.text, names_size)
    if problem == NULL:
        problem = _apply_authorities(tree, facts, mirror.text + names_size,
                                     facts.authorities_size - mirror.authorities_size)
    if problem != NULL:
        return problem
    if facts.ever_looped and not tree.ever_looped:
        tree.ever_looped = True
        _collect_everything(mirror)
    for i in range(rows):
        if mirror.rows[i].frame == NO_FRAME:
            continue
        problem = _row_problem(tree, &mirror.rows[i].row)
        if problem != NULL:
            return problem
        _collect_row(tree, mirror.rows[i].frame, &mirror.rows[i].row)
        _apply_row(tree, mirror.rows[i].frame, &mirror.rows[i].row)
    tree.cache_time_ns = facts.cache_time_ns
    tree.history_bytes = facts.bytes
    tree.taken = facts.taken
    memcpy(tree.refused, facts.refused, sizeof(tree.refused))
    mirror.trees = facts.trees
    mirror.logged = facts.logged
    mirror.names_size = facts.names_size
    mirror.authorities_size = facts.authorities_size
    return NULL


cdef Try _try(Tree* tree) noexcept nogil:
    cdef Mirror* mirror = tree.mirror
    cdef const Segment* segment = mirror.segment
    cdef const Head* head = segment_head(segment)
    cdef uint64_t sequence = load64(&head.sequence)
    cdef size_t names_size = 0
    cdef size_t authorities_size
    cdef uint32_t rows = 0
    cdef uint32_t known
    cdef const char* problem
    cdef Facts facts
    if sequence & 1:
        return OVERTAKEN
    facts = head.facts
    problem = _facts_problem(tree, &facts)
    if problem == NULL:
        if facts.trees != mirror.trees:
            # It has its ids anew.
            mirror.names_size = mirror.authorities_size = 0
        names_size = facts.names_size - mirror.names_size
        authorities_size = facts.authorities_size - mirror.authorities_size
        known = tree.names.count if facts.trees == mirror.trees else 0
        # One byte more: there may be no text, and nothing may be copied to where no memory is.
        if _reserve(mirror, facts.frames, names_size + authorities_size + 1):
            memcpy(mirror.text, segment.base + segment_part(segment, NAMES_SIXTEENTH) + mirror.names_size,
                   names_size)
            memcpy(mirror.text + names_size,
                   segment.base + segment_part(segment, AUTHORITIES_SIXTEENTH) + mirror.authorities_size,
                   authorities_size)
            rows = _read_rows(tree, &facts, known)
        else:
            problem = "there is no memory for its frames"
    fence_acquire()
    if load64(&head.sequence) != sequence:
        return OVERTAKEN
    if problem == NULL:
        problem = _apply(tree, &facts, rows, names_size)
    if problem != NULL:
        mirror.problem = problem
        return BROKEN
    mirror.sequence = sequence
    return CAUGHT_UP


cdef bint _can_catch_up(Tree* tree) noexcept nogil:
    # Waits for the owner, as long as there is hope.
    cdef Mirror* mirror = tree.mirror
    cdef const uint64_t* sequence = &segment_head(mirror.segment).sequence
    cdef uint64_t writing = 0
    cdef int64_t since_ns = 0
    cdef uint32_t tries = 0
    cdef Try outcome
    if mirror_is_current(tree):
        return True
    while True:
        outcome = _try(tree)
        if outcome != OVERTAKEN:
            return outcome == CAUGHT_UP
        tries += 1
        if tries < SPINS:
            _pause()
            continue
        segment_ask_for_pause(mirror.segment, (tries - SPINS) // TRIES_PER_DOUBLING)
        sleep_ns(NAP_NS)
        if tries % NAPS_PER_LOOK:
            continue
        if not mirror.segment.is_alive(mirror.segment):
            mirror.problem = "its owner has died in the middle of a write"
            return False
        if load64(sequence) != writing or not writing & 1:
            writing = load64(sequence)
            since_ns = monotonic_ns()
        elif monotonic_ns() - since_ns > STUCK_NS:
            mirror.problem = "its owner was stopped in the middle of a write"
            return False


cdef void mirror_catch_up(Tree* tree) noexcept nogil:
    if not _can_catch_up(tree):
        _leave(tree, False, True)


cdef bint mirror_holds(const Mirror* mirror, const FrameId* frames, const Cache* copies,
                       size_t count) noexcept nogil:
    # A sample that is appended takes a slot that is free, and later the slot of one that was dropped.
    cdef const Head* head = segment_head(mirror.segment)
    cdef const Row* rows = segment_rows(mirror.segment)
    cdef const Row* row
    cdef uint64_t sequence
    cdef uint32_t _
    cdef size_t i
    cdef bint holds
    for _ in range(<uint32_t>SPINS):
        fence_acquire()
        sequence = load64(&head.sequence)
        if sequence & 1:
            _pause()
            continue
        holds = head.facts.trees == mirror.trees
        for i in range(count):
            row = &rows[frames[i]]
            holds = (holds and row.disturbed == copies[i].disturbed
                     and row.appended - copies[i].appended <= copies[i].capacity - copies[i].count)
        fence_acquire()
        if load64(&head.sequence) == sequence:
            return holds
    return False


cdef bint _row_now(const Tree* tree, FrameId frame, bint follows, Row* row) noexcept nogil:
    # What the owner tells of a frame at this moment. False: nothing that is sound.
    cdef const Mirror* mirror = tree.mirror
    cdef const Head* head = segment_head(mirror.segment)
    cdef uint64_t sequence
    cdef uint32_t _
    for _ in range(<uint32_t>COPIES):
        sequence = load64(&head.sequence)
        row[0] = segment_rows(mirror.segment)[frame]
        fence_acquire()
        if not follows or (load64(&head.sequence) == sequence and not sequence & 1):
            # Names that are newer than those known here do not matter: the parents are found in the history.
            row.parent = NO_FRAME
            if row.authority >= tree.authorities.count:
                row.authority = tree.caches[frame].authority
            return head.facts.trees == mirror.trees and _row_problem(tree, row) == NULL
        sleep_ns(NAP_NS)
    return False


cdef bint _take_over(Tree* tree, FrameId frame, bint follows) noexcept nogil:
    # The history of one frame, as it is at this moment. What cannot be read, or has no memory, is lost.
    # False: there was no memory.
    cdef Cache* cache = &tree.caches[frame]
    cdef Cache copy
    cdef Row row
    cdef uint32_t tries
    cdef bint is_whole = False
    cdef bint has_memory = True
    for tries in range(<uint32_t>COPIES):
        if is_whole or not _row_now(tree, frame, follows, &row):
            break
        _apply_row(tree, frame, &row)
        copy = cache[0]
        if copy.capacity and cache_move(&copy, copy.capacity, SIZE_MAX // 2) != CACHE_INSERTED:
            has_memory = False
            break
        # Of the last copy, what is sound is kept.
        is_whole = not follows or mirror_holds(tree.mirror, &frame, cache, 1) or tries == COPIES - 1
        if not is_whole:
            cache_free(&copy)
    if not is_whole:
        copy = cache[0]
        copy.ring = NULL
        cache_free(&copy)
    cache[0] = copy
    # Also where cache_check finds nothing: it does not know of frames.
    cache_mend(cache, frame, tree.names.count)
    return has_memory


cdef void _stay(Tree* tree, FrameId taken) noexcept nogil:
    # Gives up the copies of the frames up to this one: whoever reads next reads all rows anew.
    cdef FrameId frame
    for frame in range(1, taken + 1):
        cache_free(&tree.caches[frame])
    tree.samples = 0
    for frame in range(taken + 1, tree.names.count):
        tree.samples += tree.caches[frame].count
    tree.mirror.sequence = 1
    tree.mirror.logged -= LOG_ENTRIES


cdef bint _leave(Tree* tree, bint follows, bint at_any_cost) noexcept nogil:
    # False: there is no memory for a history, and the tree is a mirror as before. At any cost, it is lost.
    cdef Mirror* mirror = tree.mirror
    cdef FrameId frame
    for frame in range(1, tree.names.count):
        if not _take_over(tree, frame, follows) and not at_any_cost:
            _stay(tree, frame)
            return False
    tree.mirror = NULL
    tree.is_untold = mirror.collects
    tree.cache_time_ns = mirror.own_cache_time_ns
    tree_relink(tree)
    _collect_everything(mirror)
    return True


cdef bint mirror_leave(Tree* tree, bint at_any_cost) noexcept nogil:
    cdef bint follows = _can_catch_up(tree)
    return _leave(tree, follows, at_any_cost or not follows)
