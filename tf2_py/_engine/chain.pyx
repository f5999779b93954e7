"""Owns the list of the frames that a two-time lookup passes."""

from libc.stdint cimport int64_t, uint32_t

from tf2_py._core.lookup cimport Query
from tf2_py._core.path cimport Path
from tf2_py._core.types cimport STATUS_OK, Status
from tf2_py._engine.engine cimport Engine
from tf2_py._objects.arguments cimport query_frames


cdef list chain_between(Engine engine, target_frame, int64_t target_ns, source_frame, int64_t source_ns,
                        fixed_frame):
    cdef list chain = []
    _extend(chain, _path_between(engine, fixed_frame, source_frame, source_ns))
    _extend(chain, _path_between(engine, target_frame, fixed_frame, target_ns))
    return engine.frame_names(chain)


cdef _extend(list chain, list frames):
    # A frame met again closes a detour; cut it off.
    for frame in frames:
        if frame in chain:
            del chain[chain.index(frame):]
        chain.append(frame)


cdef list _path_between(Engine engine, target_frame, source_frame, int64_t time_ns):
    # Frame ids. In a tree that ever had a loop the path may pass its top, and come back.
    cdef list frames = []
    cdef Query query
    cdef Path path
    cdef Status status
    cdef uint32_t i
    query_frames(&query, target_frame, source_frame)
    query.source_ns = time_ns
    status = engine.find_path(&query, &path)
    if status.code != STATUS_OK:
        raise engine.error(&query, status)
    _extend(frames, [path.source[i] for i in range(path.source_hops)])
    _extend(frames, [path.top])
    _extend(frames, [path.target[i - 1] for i in range(path.target_hops, 0, -1)])
    return frames
