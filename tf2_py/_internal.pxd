"""
What tf2_ros, tf2_geometry_msgs and tf2_sensor_msgs cimport from the engine. Not a public interface: it may
change at any time. They cimport nothing else of this package, so that its modules can be moved.
"""

# tf2_ros: the receiver, which inserts into an engine without the GIL, under a lock that a fork finds free.
from tf2_py._core.clock cimport monotonic_ns, system_ns
from tf2_py._core.flag cimport flag_is_set, flag_set
from tf2_py._core.forking cimport FORK_INNER, FORK_OUTER, ForkedLock, fork_forget, fork_watch
from tf2_py._core.lock cimport Lock, lock_free, lock_init, lock_write, unlock_write
from tf2_py._core.names cimport (
    NAME_NO_MEMORY,
    Name,
    Names,
    name_strip,
    names_free,
    names_init,
    names_intern,
)
from tf2_py._core.segment cimport ABOUT_AT, BOARD_AT, Board, Segment, segment_head, segment_is_ready
from tf2_py._core.tree cimport incoming_refusals
from tf2_py._core.types cimport Incoming
from tf2_py._engine.engine cimport Engine, SharedMemory
from tf2_py._engine.sharing cimport SharingEngine
from tf2_py._objects.messages cimport name_utf8
from tf2_py._wire.batch cimport Batch, batch_add_cdr, batch_begin, batch_error, batch_free, batch_read_cdr

# tf2_geometry_msgs and tf2_sensor_msgs: messages as C structs, and the maths of transforms.
from tf2_py._core.geometry cimport (
    matrix_from_quaternion,
    quaternion_conjugate,
    quaternion_multiply,
    quaternion_normalise_any,
    transform_compose,
    vector_rotate,
)
from tf2_py._core.types cimport Transform
from tf2_py._objects.layout cimport Layout
from tf2_py._objects.messages cimport (
    header_layout,
    load,
    new_header,
    new_transform_stamped,
    read_any_rotation,
    read_transform,
    transform_layout,
    transform_stamped_layout,
)
from tf2_py._objects.times cimport nanoseconds
