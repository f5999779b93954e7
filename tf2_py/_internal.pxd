"""
What tf2_ros, tf2_geometry_msgs and tf2_sensor_msgs cimport from the engine. This is not a public interface
and may change at any time. They cimport nothing else from this package, so that its modules can be moved.
"""

# tf2_ros: inboxes, which insert into an engine without the GIL, and locks that are free in a forked child.
from tf2_py._core cimport (
    NAME_NO_MEMORY,
    Batch,
    Event,
    ForkedLock,
    Incoming,
    Link,
    Lock,
    Name,
    Names,
    batch_add_cdr,
    batch_begin,
    batch_error,
    batch_free,
    batch_prefix,
    batch_read_cdr,
    batch_write_cdr,
    event_clear,
    event_init,
    event_set,
    event_wait,
    fork_forget,
    fork_watch,
    incoming_refusals,
    is_unnormalised,
    is_utf8,
    links_empty,
    lock_acquire,
    lock_ask,
    lock_await,
    lock_free,
    lock_init,
    lock_release,
    monotonic_ns,
    name_strip,
    names_find,
    names_free,
    names_init,
    names_intern,
    pthread_mutex_lock,
    pthread_mutex_unlock,
    system_ns,
    unchanging_bytes,
    word_add,
    word_exchange,
    word_load,
    word_replace,
    word_store,
)
from tf2_py._tf2_py cimport Engine, ReadHook, Tap, name_utf8

# tf2_geometry_msgs and tf2_sensor_msgs: messages as C structs, and the maths of transforms.
from tf2_py._core cimport (
    Transform,
    matrix_from_quaternion,
    quaternion_conjugate,
    quaternion_multiply,
    quaternion_normalise_any,
    transform_compose,
    vector_rotate,
)
from tf2_py._tf2_py cimport (
    Layout,
    header_layout,
    load_layouts,
    nanoseconds,
    new_header,
    new_transform_stamped,
    read_any_rotation,
    read_transform,
    transform_layout,
    transform_stamped_layout,
)
