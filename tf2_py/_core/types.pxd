"""The C structs that every module of the engine shares."""

from libc.stdint cimport int64_t, uint32_t
from libc.string cimport memset

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
    """
    const int64_t NEWEST "TF2_NEWEST"       # as a time: that of the newest sample, whatever its stamp
    # What the stamp of a message can carry, in nanoseconds: its seconds have 32 bits, with a sign.
    const int64_t MIN_STAMP_NS "TF2_MIN_STAMP_NS"
    const int64_t MAX_STAMP_NS "TF2_MAX_STAMP_NS"


cdef struct Transform:
    double translation[3]   # x y z in metres: the child's origin in the parent
    double rotation[4]      # x y z w: unit quaternion, child to parent


cdef struct Sample:
    Transform transform     # rotation with the canonical sign
    FrameId parent


cdef struct Incoming:
    # One transform to be inserted. Its maker owns the names.
    int64_t stamp_ns
    const char* parent      # UTF-8, not terminated
    size_t parent_size      # bytes
    const char* child       # likewise
    size_t child_size
    Transform transform


cdef enum Gap:
    # Why a frame's history does not answer for a time.
    GAP_NONE                # it answers
    GAP_EMPTY               # no sample at all
    GAP_SINGLE              # one sample, of another stamp
    GAP_FUTURE              # the time is later than the newest sample
    GAP_PAST                # the time is earlier than the oldest sample


cdef enum StatusCode:
    STATUS_OK
    STATUS_EXTRAPOLATION    # the history of `child` does not reach `requested_ns`
    STATUS_UNCONNECTED      # no path between the two frames
    STATUS_LOOP             # a walk took more than MAX_HOPS
    STATUS_BAD_TARGET       # the target frame's name is empty, begins with '/', or is unknown
    STATUS_BAD_SOURCE       # likewise, the source frame's
    STATUS_BAD_FIXED        # likewise, the fixed frame's


cdef enum Half:
    # Which part of a two-time lookup a status describes.
    HALF_NONE               # a simple lookup, or both
    HALF_SOURCE             # source frame to fixed frame, at the source's time
    HALF_TARGET             # fixed frame to target frame, at the target's time


cdef struct Status:
    # The outcome of a lookup.
    StatusCode code
    Half half               # the part that failed
    Gap gap                 # the fields below are facts of STATUS_EXTRAPOLATION only
    bint on_path            # the path is known: without this gap, or another on it, there is an answer
    FrameId child           # the edge that lacks data ...
    FrameId parent          # ... as far as its sample nearest to requested_ns tells; NO_FRAME: it has none
    int64_t requested_ns    # the time looked up
    int64_t edge_ns         # the stamp of its data nearest to requested_ns; undefined for GAP_EMPTY


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
    REFUSED_QUATERNION = 16         # the rotation is too short or too long to be normalised
    REFUSED_INFINITE = 32           # the translation is infinite
    REFUSED_NEGATIVE_STAMP = 64
    REFUSED_RESERVED_NAME = 128     # one of the names is NO_PARENT
    REFUSED_OLD = 256               # older than the newest stamp less the cache time
    REFUSED_STAMP_TOO_LATE = 512    # later than MAX_STAMP_NS
    REFUSED_FRAMES = 1024           # the buffer's limit of frames
    REFUSED_BYTES = 2048            # the buffer's limit of bytes
    REFUSAL_KINDS = 12              # how many bits there are
