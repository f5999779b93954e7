"""
Memory that the processes of a machine share: one process writes it, the owner, and others read it.

The engine knows no operating system. Whoever maps the memory makes a Segment, with the functions that the
engine calls. All offsets count from its first byte:

    0           Head: what the owner tells of the tree; from ABOUT_AT on a text, not the engine's
    BOARD_AT    Board: the one page that readers write, too
    LOG_AT      the frames that changed last, a ring of LOG_ENTRIES ids
    rows_at     a Row for each frame
    names_at    the frames' names in the order of their ids, each as its size, a uint32_t, and its bytes
    authorities_at  the authorities, likewise
    rings_at    the histories, given out by an Arena

The file is as large as its mapping from the beginning on. Memory is committed piece by piece, by the owner.
"""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t

from tf2_py._core.types cimport REFUSAL_KINDS

cdef enum:
    SEGMENT_VERSION = 1
    ABOUT_AT = 1024
    BOARD_AT = 4096
    LOG_AT = 8192
    LOG_ENTRIES = 16384
    ROWS_AT = 131072
    # Of the segment's size, in sixteenths: where the parts begin that grow.
    NAMES_SIXTEENTH = 1
    AUTHORITIES_SIXTEENTH = 2
    RINGS_SIXTEENTH = 3
    MOST_DOUBLINGS = 8          # of a pause
    LEAST_SIXTEENTH = 1048576   # bytes: what is smaller is no segment

cdef extern from *:
    """
    #include <stdint.h>
    #define TF2_MAGIC 0x6b6e69736e617274ULL
    #define TF2_LOAD64(where) __atomic_load_n(where, __ATOMIC_ACQUIRE)
    #define TF2_STORE64(where, value) __atomic_store_n(where, value, __ATOMIC_RELEASE)
    #define TF2_LOAD32(where) __atomic_load_n(where, __ATOMIC_RELAXED)
    #define TF2_STORE32(where, value) __atomic_store_n(where, value, __ATOMIC_RELAXED)
    #define TF2_FENCE_ACQUIRE() __atomic_thread_fence(__ATOMIC_ACQUIRE)
    #define TF2_FENCE_RELEASE() __atomic_thread_fence(__ATOMIC_RELEASE)
    #define TF2_FENCE_FULL() __atomic_thread_fence(__ATOMIC_SEQ_CST)
    """
    const uint64_t SEGMENT_MAGIC "TF2_MAGIC"
    uint64_t load64 "TF2_LOAD64"(const uint64_t* where) nogil
    void store64 "TF2_STORE64"(uint64_t* where, uint64_t value) nogil
    uint32_t load32 "TF2_LOAD32"(const uint32_t* where) nogil
    void store32 "TF2_STORE32"(uint32_t* where, uint32_t value) nogil
    void fence_acquire "TF2_FENCE_ACQUIRE"() nogil
    void fence_release "TF2_FENCE_RELEASE"() nogil
    void fence_full "TF2_FENCE_FULL"() nogil


cdef struct Facts:
    # What the owner tells of its tree, beside the rows; see Tree.
    uint64_t trees              # it ever had: a tree that is replaced takes its ids along
    uint64_t logged             # entries ever written into the log
    uint64_t names_size         # bytes of all names with their sizes; so is the next
    uint64_t authorities_size
    uint32_t frames             # names; so many rows are valid
    uint32_t authorities
    uint64_t ever_looped        # 0 or 1
    int64_t cache_time_ns
    uint64_t bytes              # allocated for names and histories
    uint64_t taken
    uint64_t refused[REFUSAL_KINDS]
    uint64_t malformed


cdef struct Head:
    uint64_t magic
    uint32_t version
    uint32_t head_bytes         # sizes of structs: another compiler may lay them out in another way
    uint32_t row_bytes
    uint32_t sample_bytes
    uint64_t size               # of the segment, in bytes
    uint64_t sequence           # even: at rest; odd: the owner is writing. Its low half is what is slept on.
    Facts facts


cdef struct Board:
    # Nothing but a needless wake or pause depends on it.
    uint32_t somebody_waits     # for a change: the owner wakes all, once
    uint32_t somebody_is_late   # a reader is overtaken: the owner pauses, once, the longer the larger it is


cdef struct Row:
    # A Cache in 64 bytes, with an offset instead of addresses.
    uint64_t ring               # offset of its Ring; 0: there is none
    int64_t newest_ns
    int64_t oldest_ns
    uint32_t capacity
    uint32_t head
    uint32_t count
    uint32_t parent_changes
    uint32_t mostly_empty_for
    uint32_t authority
    uint32_t parent             # as in Tree.parents
    uint32_t appended
    uint32_t disturbed
    uint8_t kind
    uint8_t is_parent
    uint8_t unused[2]


cdef struct Segment:
    char* base
    size_t size                 # bytes
    Board* board                # the board, mapped for writing
    void* place                 # for the functions below, which whoever made it gives
    # Called by the owner: commits memory. 0, or -1: there is none.
    int (*commit)(Segment* segment, size_t start, size_t size) noexcept nogil
    # Wakes all, of any process, that sleep on a word.
    void (*wake)(const uint32_t* word) noexcept nogil
    # Sleeps while the word is `seen`, for so long at most; may wake earlier.
    void (*sleep)(const uint32_t* word, uint32_t seen, int64_t ns) noexcept nogil
    # Whether the owner lives, and the memory is whole.
    bint (*is_alive)(Segment* segment) noexcept nogil


cdef inline Head* segment_head(const Segment* segment) noexcept nogil:
    return <Head*>segment.base


cdef inline const uint32_t* segment_word(const Segment* segment) noexcept nogil:
    # What those sleep on that wait for a change: the low half of the sequence.
    return <const uint32_t*>&segment_head(segment).sequence


cdef inline void segment_ask_for_pause(const Segment* segment, uint32_t doublings) noexcept nogil:
    # Of the owner, after its next write: that much longer than the shortest one.
    store32(&segment.board.somebody_is_late, 1 + min(doublings, <uint32_t>MOST_DOUBLINGS))


cdef inline bint segment_is_ready(const Segment* segment) noexcept nogil:
    # What prepares it writes this last.
    return load64(&segment_head(segment).magic) != 0


cdef inline Row* segment_rows(const Segment* segment) noexcept nogil:
    return <Row*>(segment.base + ROWS_AT)


cdef inline uint32_t* segment_log(const Segment* segment) noexcept nogil:
    return <uint32_t*>(segment.base + LOG_AT)


cdef inline size_t segment_part(const Segment* segment, size_t sixteenth) noexcept nogil:
    # Where a part begins.
    return segment.size // 16 * sixteenth


cdef inline size_t segment_most_rows(const Segment* segment) noexcept nogil:
    return (segment_part(segment, NAMES_SIXTEENTH) - ROWS_AT) // sizeof(Row)
