"""The frames that a two-time lookup passes."""

from libc.stdint cimport int64_t

from tf2_py._engine.engine cimport Engine

# Names: from the source up to the common ancestor and down to the target, by way of the fixed frame, each
# once. Raises what the lookup raises.
cdef list chain_between(Engine engine, target_frame, int64_t target_ns, source_frame, int64_t source_ns,
                        fixed_frame)
