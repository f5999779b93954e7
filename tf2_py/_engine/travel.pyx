"""
Owns the state in which a buffer travels: a dict of numbers, names, and arrays.

=================  =====================================================================================
``version``        VERSION; a buffer reads no other.
``cache_time_ns``  int
``max_frames``     int; so are ``max_bytes`` and ``max_waiters``.
``ever_looped``    bool: whether the parents of the frames ever formed a loop.
``taken``          int: transforms accepted; ``refused``: a tuple of ints, by reason; ``malformed``: messages.
``names``          bytes: the frames' names in the order of their ids, UTF-8, each followed by a NUL.
``authorities``    bytes, likewise.
``frames``         uint32 (F, FRAME_ROW_COLUMNS): a FrameRow for each name.
``stamps``         int64 (N,), ns: those of the samples of the first frame, oldest first, then of the next.
``transforms``     float64 (N, 7): x y z in metres, and the rotation x y z w.
``parents``        uint32 (N,): places of names, from 1.
=================  =====================================================================================
"""

from libc.stdint cimport INT64_MAX, SIZE_MAX, UINT32_MAX, UINT64_MAX, int64_t, uint32_t
from libc.string cimport memset

from tf2_py._core.cache_copy cimport TRANSFORM_DOUBLES
from tf2_py._core.lock cimport Lock
from tf2_py._core.tree cimport TREE_LACKS_MEMORY, Tree, tree_free
from tf2_py._core.tree_copy cimport (
    FRAME_ROW_COLUMNS,
    FrameRow,
    PinnedTree,
    TreeArrays,
    tree_export,
    tree_import,
    tree_pin,
    tree_unpin,
)
from tf2_py._core.types cimport REFUSAL_KINDS

from tf2_py._objects.arrays import new_array, received_array
from tf2_py._objects.printable import printable

cdef enum:
    VERSION = 1

cdef frozenset KEYS = frozenset({
    "version", "cache_time_ns", "max_frames", "max_bytes", "max_waiters", "ever_looped", "taken", "refused",
    "malformed", "names", "authorities", "frames", "stamps", "transforms", "parents",
})


cdef dict state_of(const Tree* tree, Lock* lock, unsigned long long malformed):
    cdef PinnedTree pinned
    cdef TreeArrays arrays
    cdef uint32_t[:, ::1] frames
    cdef int64_t[::1] stamps
    cdef double[:, ::1] transforms
    cdef uint32_t[::1] parents
    cdef bint is_pinned
    cdef uint32_t kind
    with nogil:
        is_pinned = tree_pin(tree, lock, &pinned)
    if not is_pinned:
        raise MemoryError
    try:
        frames_array = new_array((pinned.view.names.count - 1, FRAME_ROW_COLUMNS), "uint32")
        stamps_array = new_array((pinned.view.samples,), "int64")
        transforms_array = new_array((pinned.view.samples, TRANSFORM_DOUBLES), "float64")
        parents_array = new_array((pinned.view.samples,), "uint32")
        frames, stamps, transforms, parents = frames_array, stamps_array, transforms_array, parents_array
        arrays.frames = <FrameRow*>&frames[0, 0]
        arrays.stamps = &stamps[0]
        arrays.transforms = &transforms[0, 0]
        arrays.parents = &parents[0]
        with nogil:
            tree_export(&pinned, &arrays)
        return {
            "version": VERSION,
            "cache_time_ns": arrays.cache_time_ns,
            "max_frames": arrays.limits.frames,
            "max_bytes": arrays.limits.bytes,
            "max_waiters": arrays.limits.waiters,
            "ever_looped": bool(arrays.ever_looped),
            "taken": arrays.taken,
            "refused": tuple([arrays.refused[kind] for kind in range(<uint32_t>REFUSAL_KINDS)]),
            "malformed": malformed,
            "names": arrays.names[:arrays.names_size],
            "authorities": arrays.authorities[:arrays.authorities_size],
            "frames": frames_array,
            "stamps": stamps_array,
            "transforms": transforms_array,
            "parents": parents_array,
        }
    finally:
        with nogil:
            tree_unpin(&pinned)


cdef object _refusal(what):
    return ValueError(f"not the state of a buffer: {what}")


cdef object _number(value, what, most, least=0):
    # Within `least` and `most`; a bool is none.
    if type(value) is not int:
        raise _refusal(f"{what} is no int but {type(value).__name__}")
    if not least <= value <= most:
        shown = value if value.bit_length() < 128 else "too large"
        raise _refusal(f"{what} is {shown}, not within {least} and {most}")
    return value


cdef bytes _names(dict state, str key):
    text = state[key]
    if type(text) is not bytes:
        raise _refusal(f"{key} is no bytes but {type(text).__name__}")
    try:
        text.decode("utf-8")
    except UnicodeDecodeError as error:
        raise _refusal(f"{key} is not UTF-8: {error.reason} at byte {error.start}") from None
    return text


cdef object _array(dict state, str key, tuple shape, str dtype):
    try:
        return received_array(state[key], shape, dtype)
    except ValueError as error:
        raise _refusal(f"{key} {error}") from None


cdef int read_state(dict state, Tree* tree, unsigned long long* malformed) except -1:
    cdef TreeArrays arrays
    cdef const uint32_t[:, ::1] frames
    cdef const int64_t[::1] stamps
    cdef const double[:, ::1] transforms
    cdef const uint32_t[::1] parents
    cdef const char* problem
    cdef bytes names, authorities
    cdef uint32_t kind
    version = _number(state.get("version"), "version", UINT32_MAX)
    if version != VERSION:
        raise _refusal(f"it is of version {version}; this one reads version {VERSION}")
    if state.keys() != KEYS:
        wrong = sorted(map(repr, state.keys() ^ KEYS))
        raise _refusal(f"it lacks, or has too many: {printable(', '.join(wrong))}")
    memset(&arrays, 0, sizeof(TreeArrays))
    arrays.cache_time_ns = _number(state["cache_time_ns"], "cache_time_ns", INT64_MAX)
    arrays.limits.frames = _number(state["max_frames"], "max_frames", UINT32_MAX, 1)
    arrays.limits.bytes = _number(state["max_bytes"], "max_bytes", SIZE_MAX, 1)
    arrays.limits.waiters = _number(state["max_waiters"], "max_waiters", UINT32_MAX, 1)
    arrays.taken = _number(state["taken"], "taken", UINT64_MAX)
    malformed[0] = _number(state["malformed"], "malformed", UINT64_MAX)
    if type(state["ever_looped"]) is not bool:
        raise _refusal("ever_looped is no bool")
    arrays.ever_looped = state["ever_looped"]
    refused = state["refused"]
    if type(refused) is not tuple or len(refused) != REFUSAL_KINDS:
        raise _refusal(f"refused is no tuple of {REFUSAL_KINDS} ints")
    for kind in range(<uint32_t>REFUSAL_KINDS):
        arrays.refused[kind] = _number(refused[kind], "refused", UINT64_MAX)
    names, authorities = _names(state, "names"), _names(state, "authorities")
    # A copy: it decides how much is read of the others, and another thread may write into it.
    frames_array = _array(state, "frames", (None, FRAME_ROW_COLUMNS), "uint32").copy()
    stamps_array = _array(state, "stamps", (None,), "int64")
    transforms_array = _array(state, "transforms", (len(stamps_array), TRANSFORM_DOUBLES), "float64")
    parents_array = _array(state, "parents", (len(stamps_array),), "uint32")
    if len(frames_array) >= UINT32_MAX:
        raise _refusal("there are too many frames")
    frames, stamps, transforms, parents = frames_array, stamps_array, transforms_array, parents_array
    arrays.names, arrays.names_size = names, len(names)
    arrays.authorities, arrays.authorities_size = authorities, len(authorities)
    arrays.frames, arrays.frame_count = <FrameRow*>&frames[0, 0], len(frames_array)
    arrays.stamps, arrays.sample_count = <int64_t*>&stamps[0], len(stamps_array)
    arrays.transforms = <double*>&transforms[0, 0]
    arrays.parents = <uint32_t*>&parents[0]
    memset(tree, 0, sizeof(Tree))
    with nogil:
        problem = tree_import(&arrays, tree)
        if problem != NULL:
            tree_free(tree)
    if problem == TREE_LACKS_MEMORY:
        raise MemoryError
    if problem != NULL:
        raise _refusal(problem.decode())
    return 0
