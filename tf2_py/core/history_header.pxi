# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
The history of one frame: a ring of samples sorted by stamp.

Only this chapter knows how samples lie in memory; all others call its functions. The functions that read or
change a History need the tree's lock, except on a pinned copy.
"""

cdef enum HistoryKind:
    HISTORY_NONE            # the frame was never a child: no samples, no memory
    HISTORY_DYNAMIC
    HISTORY_STATIC          # one sample, for every time


cdef struct FileMapping:
    # The bytes of a frozen file in memory, read-only. See frozen_format_header.pxi.
    void* start                 # at a page
    size_t size                 # bytes
    uint32_t owners             # histories with samples there, and who opens it; read and written atomically


cdef struct HistoryMemory:
    # The first bytes of the memory that holds a frame's samples; those of a mapping are elsewhere.
    uint32_t owners             # the history and its pinned copies; read and written atomically
    uint32_t pinned_from        # slot of the oldest sample of a pinned copy; valid where owners > 1
    size_t bytes                # allocated in this process, this head included
    FileMapping* mapping        # which has the samples, and pins all of them for ever; NULL: they follow


cdef struct History:
    # The ring, for this chapter only. The oldest sample has the index 0 and lies in slot `head`; slot 0
    # follows slot `capacity - 1`. Two parallel arrays, so that a search reads little memory.
    # Equal stamps lie in order of arrival.
    HistoryMemory* memory       # the memory of both arrays; NULL: capacity 0
    int64_t* stamps             # ns, by slot
    Sample* samples             # by slot; each is one 64-byte line
    uint32_t capacity           # slots allocated
    uint32_t head               # slot of the oldest sample
    uint32_t mostly_empty_for   # inserts since the ring was last a quarter full
    # What others may read.
    uint32_t count              # samples
    uint32_t parent_changes     # how many neighbors have different parents; 0: one parent at all times
    HistoryKind kind
    int64_t newest_ns           # stamp of the newest sample; 0 without samples, and in a static history
    int64_t oldest_ns           # stamp of the oldest sample; 0 in the same cases
    # What the tree writes.
    uint32_t authority          # id of the sender of the last sample; NAME_UNKNOWN: there was none
    bint is_parent              # a sample of some frame has named this frame as its parent
    bint is_hidden              # forgotten: the name counts as unknown until a transform uses it again
    bint was_unnormalized       # an unnormalized rotation of this frame has been reported


cdef enum:
    NEWEST_HINT = 0x7FFFFFFF    # begin the search at the newest sample; most lookups need a recent time
    PREFETCH_FROM = 16          # samples; in a shorter history any search is fast


cdef inline uint32_t _history_slot(const History* history, uint32_t index) noexcept nogil:
    # The sum cannot wrap: capacities stay below 2^31.
    cdef uint32_t slot = history.head + index
    return slot if slot < history.capacity else slot - history.capacity


cdef inline size_t history_allocated(const History* history) noexcept nogil:
    # Allocated for its samples.
    return 0 if history.memory == NULL else history.memory.bytes


# What one sample holds; `index` < `count`, 0 is the oldest.
cdef inline int64_t history_stamp_of(const History* history, uint32_t index) noexcept nogil:
    return history.stamps[_history_slot(history, index)]


cdef inline const Sample* history_sample_of(const History* history, uint32_t index) noexcept nogil:
    return &history.samples[_history_slot(history, index)]


cdef inline const Transform* history_transform_of(const History* history, uint32_t index) noexcept nogil:
    return &history.samples[_history_slot(history, index)].transform


cdef inline FrameId history_parent_of(const History* history, uint32_t index) noexcept nogil:
    return history.samples[_history_slot(history, index)].parent


cdef inline FrameId history_newest_parent(const History* history) noexcept nogil:
    # NO_FRAME if there are no samples.
    return NO_FRAME if history.count == 0 else history_parent_of(history, history.count - 1)


cdef inline FrameId history_oldest_parent(const History* history) noexcept nogil:
    # NO_FRAME if there are no samples.
    return NO_FRAME if history.count == 0 else history_parent_of(history, 0)


cdef inline const Transform* history_newest_transform(const History* history) noexcept nogil:
    # The history must have samples; a static one has a single transform.
    return history_transform_of(history, history.count - 1)


cdef inline int64_t age_at(int64_t newest_ns, int64_t now_ns) noexcept nogil:
    # Of the sample with this stamp, in ns; INT64_MAX: the clock has not begun.
    return INT64_MAX if now_ns <= 0 else now_ns - newest_ns


# Memory: growing, shrinking, pinning.
#
# A lookup may read samples without the lock if it pins the ring first. Then no sample that the copy refers to
# is overwritten: a write that would overwrite one first moves the samples to other memory, and the last owner
# of the old memory frees it.

cdef enum:
    FIRST_CAPACITY = 8              # samples, of a dynamic history
    LAST_CAPACITY = 0x7FFFFFFF      # samples

cdef enum HistoryInsert:
    HISTORY_INSERTED
    HISTORY_DUPLICATE
    HISTORY_TOO_OLD
    HISTORY_NO_MEMORY
    HISTORY_FULL            # the memory would have to grow by more than the limit allows

# Zero a History before its first use; history_free zeroes it again except for what the tree writes.
cdef void history_free(History* history) noexcept nogil
# Drops all samples and keeps the memory. Not for static histories.
cdef void history_clear(History* history) noexcept nogil
# Pin with the lock held. `copy` may be read without the lock until it is unpinned.
cdef void history_pin(const History* history, History* copy) noexcept nogil
cdef void history_unpin(History* copy) noexcept nogil
# Lets go of a mapping, which ends with its last owner.
cdef void mapping_release(FileMapping* mapping) noexcept nogil
# Makes a History, which is zeroed except for its kind, of `count` samples, oldest first: of those in a
# mapping, which it then owns as well, or of a copy. The rest of what others read is the caller's. 0, or -1
# without memory; the History is then useless. Whether all of this is consistent is for history_check to say.
cdef int history_map(History* history, FileMapping* mapping, const int64_t* stamps, const Sample* samples,
                     uint32_t count) noexcept nogil
cdef int history_import(History* history, const int64_t* stamps, const Sample* samples,
                        uint32_t count) noexcept nogil


cdef enum HopData:
    # What the history of a frame has answered with.
    HOP_STATIC          # its one sample, for every time
    HOP_SAMPLE          # a sample with this stamp
    HOP_INTERPOLATED    # the samples on both sides of the time
    HOP_KEPT            # the sample before the time: the one after it has another parent
    HOP_HELD            # its newest sample, within its tolerance
    HOP_EXTRAPOLATED    # its last two samples, within its tolerance


# What the history answers for a time.

cdef extern from *:
    void __builtin_prefetch(const void* address) nogil


cdef inline uint32_t _history_guess(const History* history, int64_t time_ns) noexcept nogil:
    # The index of the sample before time_ns, if the stamps were even; below
    # `count - 1`. For two samples or more and oldest_ns <= time_ns < newest_ns.
    cdef uint32_t last = history.count - 1
    cdef double part = <double>(time_ns - history.oldest_ns) / <double>(history.newest_ns - history.oldest_ns)
    return min(<uint32_t>(part * <double>last), last - 1)


cdef inline uint32_t history_prefetch(const History* history, int64_t time_ns) noexcept nogil:
    # The hint for finding a time. Prefetches the memory that the search will need, so that in long histories
    # the delays of several frames or times overlap.
    cdef uint32_t guess, slot
    if history.count < PREFETCH_FROM or time_ns >= history.newest_ns or time_ns < history.oldest_ns:
        return NEWEST_HINT
    guess = _history_guess(history, time_ns)
    slot = _history_slot(history, guess)
    __builtin_prefetch(&history.stamps[slot])
    __builtin_prefetch(&history.samples[slot])
    if slot + 1 < history.capacity:
        __builtin_prefetch(&history.samples[slot + 1])
    return guess + 1


# Why the history does not answer; GAP_NONE: it does. Time 0 means the newest sample.
cdef Gap history_gap(const History* history, int64_t time_ns) noexcept nogil

cdef struct Neighbors:
    # The samples on both sides of a time. If one sample is the answer, both are that sample.
    const Transform* older
    const Transform* newer
    int64_t older_ns        # their stamps; every time between these, but not at them, has the same neighbors
    int64_t newer_ns


cdef inline double neighbors_ratio(const Neighbors* around, int64_t time_ns) noexcept nogil:
    # The relative position of the time between them, 0 .. 1; 0 if both are the same.
    if around.older_ns == around.newer_ns:
        return 0.0
    return <double>(time_ns - around.older_ns) / <double>(around.newer_ns - around.older_ns)


# `hint`: where to look first, and afterwards where the answer was.
cdef Gap history_neighbors(const History* history, int64_t time_ns, uint32_t* hint,
                           Neighbors* out) noexcept nogil
# Interpolated between the neighbors: linear translation, slerp of the rotation.
cdef Gap history_transform_at(const History* history, int64_t time_ns, uint32_t hint,
                              Transform* out) noexcept nogil
# As history_transform_at, under a policy that is given, with its tolerance for this frame. `used_ns`: the
# time, or the newest stamp where that stands for it.
cdef Gap history_transform_under(const History* history, int64_t time_ns, const Policy* policy,
                                 int64_t tolerance_ns, Transform* out, int64_t* used_ns) noexcept nogil
# The stamps on both sides of a time, also where the parent changes between them. False: a sample has this
# time, or it is not between two samples.
cdef bint history_stamps_around(const History* history, int64_t time_ns, int64_t* older_ns,
                                int64_t* newer_ns) noexcept nogil


cdef inline bint history_has_velocity(const History* history) noexcept nogil:
    # Whether an extrapolation moves: the last two samples have different stamps and one parent.
    cdef uint32_t last = history.count - 1
    return (history.count > 1 and history_stamp_of(history, last - 1) != history.newest_ns
            and history_parent_of(history, last - 1) == history_parent_of(history, last))


cdef inline HopData history_beyond(const History* history, const Policy* policy, int64_t tolerance_ns,
                                   int64_t* time_ns) noexcept nogil:
    # Where a policy has an answer beyond the samples, what it is made of, and `time_ns` becomes the stamp for
    # which they have data; HOP_SAMPLE: nowhere, so the samples decide.
    if (history.kind != HISTORY_DYNAMIC or history.count == 0 or time_ns[0] <= history.newest_ns
            or time_ns[0] - history.newest_ns > tolerance_ns):
        return HOP_SAMPLE
    time_ns[0] = history.newest_ns
    return HOP_EXTRAPOLATED if policy.is_given and policy.extrapolates else HOP_HELD


# The earliest time T such that, from T to `time_ns`, either every answer has the same parent, or there is no
# answer at all. `time_ns` is not 0. INT64_MIN: this holds for all earlier times.
cdef int64_t history_unchanged_since(const History* history, int64_t time_ns) noexcept nogil
# NO_FRAME: the history does not answer.
cdef FrameId history_parent_at(const History* history, int64_t time_ns) noexcept nogil


# Changing it.

cdef struct TimeRange:
    # Both included; empty if first > last.
    int64_t first           # ns, as all times
    int64_t last


cdef struct HistoryChange:
    # What an insert has changed.
    TimeRange covered       # times that have samples around them only since this insert; may be too large
    uint32_t moved          # samples copied to other slots
    bint displaced          # if inserted: the oldest sample has made room


cdef struct Retention:
    # How much a dynamic history keeps. All of it is read by retention_horizon only.
    int64_t cache_time_ns   # how far it reaches back from its newest stamp; >= 0


cdef inline int64_t retention_horizon(const Retention* retention, int64_t newest_ns) noexcept nogil:
    # The one rule of what is lost, if `newest_ns` is the newest stamp: a sample with an earlier stamp than
    # this is pruned by the next insert, and refused when it arrives.
    return newest_ns - retention.cache_time_ns


cdef inline int64_t history_horizon(const History* history, const Retention* retention,
                                    int64_t newest_ns) noexcept nogil:
    # The same; without samples, nothing is refused.
    return retention_horizon(retention, newest_ns) if history.count else INT64_MIN


# `growth_limit`: by how many bytes the memory may grow. `change` is always filled.
# `stamp_ns` >= 0, a unit rotation in `sample`.
cdef HistoryInsert history_insert(History* history, int64_t stamp_ns, const Sample* sample,
                                  const Retention* retention, size_t growth_limit,
                                  HistoryChange* change) noexcept nogil
cdef HistoryInsert history_set_static(History* history, int64_t stamp_ns, const Sample* sample,
                                      size_t growth_limit, HistoryChange* change) noexcept nogil

# To build what takes the place of a history: `fresh` becomes an empty one of the same frame, with memory for
# `capacity` samples, at least FIRST_CAPACITY of a dynamic one. HISTORY_INSERTED; or HISTORY_FULL or
# HISTORY_NO_MEMORY. `growth_limit`: by how many bytes it may exceed `old`, which remains.
cdef HistoryInsert history_begin(const History* old, HistoryKind kind, uint32_t capacity, size_t growth_limit,
                                 History* fresh) noexcept nogil
# Append after the newest sample of a dynamic history. Its memory has a free slot, and no other owner.
cdef void history_append(History* history, int64_t stamp_ns, const Sample* sample) noexcept nogil
# The index of the first sample with a later stamp; `count`: there is none. Not for static histories.
cdef uint32_t history_first_after(const History* history, int64_t time_ns) noexcept nogil

# NULL, or which invariant does not hold; `where` is then the index of the sample, or `count`: of none.
cdef const char* history_check(const History* history, uint32_t* where) noexcept nogil


# Copying it into flat arrays.

cdef enum:
    TRANSFORM_DOUBLES = 7       # per transform: translation x y z in meters, rotation x y z w

# `count` elements each, oldest first. The history may be a pinned copy.
cdef void history_export(const History* history, int64_t* stamps, double* transforms,
                         uint32_t* parents) noexcept nogil
# The same for `count` samples, at least one, from the index `first` on, as they lie in a history.
cdef void history_copy_stamps(const History* history, uint32_t first, uint32_t count,
                              int64_t* stamps) noexcept nogil
cdef void history_copy_samples(const History* history, uint32_t first, uint32_t count,
                               Sample* samples) noexcept nogil
