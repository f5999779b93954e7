# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The C structs that every chapter shares."""

# A frame is an index into the tree's arrays, never a pointer kept across growth.
ctypedef uint32_t FrameId

cdef enum:
    NO_FRAME = 0        # id of the reserved name NO_PARENT; as a parent: there is none
    LINE_BYTES = 64     # of a line of the processor's cache, and of a Sample
    MAX_HOPS = 1000     # hops on each side of a lookup, tf2's limit
    MIXED_PARENTS = 0x80000000      # flag beside a frame's parent: its history holds more than one

cdef extern from *:
    """
    #include <stdint.h>
    #define TF2_NEWEST INT64_MIN
    #define TF2_MIN_STAMP_NS (-2147483648000000000LL)
    #define TF2_MAX_STAMP_NS 2147483647999999999LL
    #define TF2_YEAR_NS (365LL * 86400 * 1000000000)
    """
    const int64_t NEWEST "TF2_NEWEST"       # as a time: that of the newest sample, for any stamp
    # What the stamp of a message can carry, in nanoseconds: its seconds have 32 bits, with a sign.
    const int64_t MIN_STAMP_NS "TF2_MIN_STAMP_NS"
    const int64_t MAX_STAMP_NS "TF2_MAX_STAMP_NS"
    const int64_t YEAR_NS "TF2_YEAR_NS"


cdef struct Transform:
    double translation[3]   # x y z in meters: the child's origin in the parent
    double rotation[4]      # x y z w: unit quaternion, child to parent


cdef struct Sample:
    Transform transform     # rotation with the canonical sign
    FrameId parent
    uint32_t reserved       # 0


cdef struct Incoming:
    # One transform to be inserted. Its creator owns the names.
    int64_t stamp_ns
    const char* parent      # UTF-8, not terminated
    size_t parent_size      # bytes
    const char* child       # UTF-8, not terminated
    size_t child_size
    Transform transform
    double squared_length   # outcome: of the rotation, before it was normalized


cdef enum Gap:
    # Why the history of a frame has no answer for a time.
    GAP_NONE                # it has one
    GAP_EMPTY               # no sample at all
    GAP_SINGLE              # one sample, of another stamp
    GAP_FUTURE              # the time is later than the newest sample
    GAP_PAST                # the time is earlier than the oldest sample
    # It has one, which a Policy does not allow:
    GAP_LONG                # the samples around the time are too far apart
    GAP_STALE               # the newest sample is too old, by a clock


cdef struct FrameLimit:
    const char* name        # UTF-8, owned by the policy's object
    Py_ssize_t size         # bytes
    int64_t limit_ns


cdef struct FrameLimits:
    # A duration for each frame.
    const FrameLimit* named     # those of some frames
    uint32_t count          # of `named`
    int64_t others_ns       # that of all other frames


cdef struct ClockReading:
    # The clock by which the age of samples is counted.
    bint is_system          # it shows the system's time, which is read when an age is judged
    int64_t now_ns          # what it has shown; 0 or less: it has not begun


cdef struct Policy:
    # What a program asks of a lookup beyond tf2's.
    bint is_given           # False: nothing, and the other fields are not set
    bint extrapolates       # after its newest sample a frame goes on at its last velocity; False: it stays
    bint judges_age         # of a lookup at the latest common time; the last two fields are set
    FrameLimits tolerance   # how far after its newest sample a frame has an answer
    int64_t max_gap_ns      # between samples that are further apart it has none
    FrameLimits max_age     # how old the newest sample of a moving frame may be; INT64_MAX: any age
    const ClockReading* clock   # set by the engine


cdef enum StatusCode:
    STATUS_OK
    STATUS_EXTRAPOLATION    # frames lack data for `requested_ns`, `child` the most
    STATUS_UNCONNECTED      # no path between the frames; `child` is the source's root, `parent` the target's
    STATUS_LOOP             # a walk took more than MAX_HOPS
    STATUS_BAD_TARGET       # the target frame's name is empty, begins with '/', or is unknown
    STATUS_BAD_SOURCE       # the same for the source frame
    STATUS_BAD_FIXED        # the same for the fixed frame
    STATUS_BAD_LIMIT        # a limit could never apply: its frame is unknown, was never a child, or is static
    STATUS_NOT_NEW          # for a waiter for a change: the answer is the one that it already has


cdef enum Half:
    # Which part of a two-time lookup a status describes.
    HALF_NONE               # a simple lookup, or both
    HALF_SOURCE             # source frame to fixed frame, at the source's time
    HALF_TARGET             # fixed frame to target frame, at the target's time


cdef struct Status:
    # The outcome of a lookup.
    StatusCode code
    Half half               # the part that failed
    # Unless stated above, the fields below are facts of STATUS_EXTRAPOLATION only. Those of STATUS_BAD_LIMIT
    # are `child`, the frame of the limit, NO_FRAME if unknown; `parent`, which is no frame here, but the
    # index of the limit, those of `tolerance` first; and `gap`, GAP_NONE unless data is missing, too.
    Gap gap
    Gap quoted_gap          # of the frame that tf2's sentence is about; not for GAP_LONG
    FrameId child           # the frame whose data is furthest from requested_ns ...
    FrameId parent          # ... and its parent in the sample nearest to requested_ns; NO_FRAME: none
    int64_t requested_ns    # the time looked up; of GAP_STALE: that of the clock
    int64_t edge_ns         # the stamp of its data nearest to requested_ns; 0 for GAP_EMPTY
    # The stamp that tf2's sentence quotes; for GAP_LONG, the stamp after edge_ns; for GAP_STALE, how old the
    # data may be.
    int64_t other_ns


cdef inline Status status_of(StatusCode code) noexcept nogil:
    # A status without further facts.
    cdef Status status
    memset(&status, 0, sizeof(Status))
    status.code = code
    return status


cdef enum:
    # Why a transform is refused; bits, because several may apply.
    REFUSED_SELF_TRANSFORM = 1      # parent and child are the same frame
    REFUSED_NO_PARENT = 2           # the parent's name is empty
    REFUSED_NO_CHILD = 4            # the child's name is empty
    REFUSED_NAN = 8                 # a number is NaN
    REFUSED_QUATERNION = 16         # the rotation is too short or too long to be normalized
    REFUSED_INFINITE = 32           # the translation is infinite
    REFUSED_NEGATIVE_STAMP = 64
    REFUSED_RESERVED_NAME = 128     # one of the names is NO_PARENT
    REFUSED_OLD = 256               # older than the newest stamp less the cache time
    REFUSED_STAMP_TOO_LATE = 512    # later than MAX_STAMP_NS
    REFUSED_FRAMES = 1024           # the buffer's limit of frames
    REFUSED_BYTES = 2048            # the buffer's limit of bytes
    # Of transforms that were to replace others:
    REFUSED_KIND = 4096             # the frame is static, and they are not, or the reverse
    REFUSED_TOGETHER = 8192         # another one of the same frame was refused
    REFUSAL_KINDS = 14              # how many bits there are


# A stamp as one count of nanoseconds, and as the seconds and nanoseconds of a message.

cdef enum:
    NS_PER_S = 1000000000


cdef inline int64_t stamp_join(int64_t sec, int64_t nanosec) noexcept nogil:
    # For a `sec` of 32 bits, any `nanosec` of 32 bits.
    return sec * NS_PER_S + nanosec


cdef inline void stamp_split(int64_t stamp_ns, int64_t* sec, uint32_t* nanosec) noexcept nogil:
    # `nanosec` is below NS_PER_S also before the epoch, although C's division rounds towards zero.
    cdef int64_t rest = stamp_ns % NS_PER_S
    sec[0] = stamp_ns // NS_PER_S
    if rest < 0:
        sec[0] -= 1
        rest += NS_PER_S
    nanosec[0] = <uint32_t>rest
