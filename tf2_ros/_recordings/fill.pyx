"""Owns the loop that takes raw messages of a recording into a buffer, without a Python call per message."""

from cpython.buffer cimport PyBUF_SIMPLE, PyBuffer_Release, PyObject_CheckBuffer, PyObject_GetBuffer
from cpython.long cimport PyLong_AsLongLongAndOverflow
from cpython.object cimport PyObject
from libc.stddef cimport size_t
from libc.stdint cimport INT64_MAX, int64_t
from libc.stdlib cimport free, malloc
from libc.string cimport memcpy, memset

from tf2_py._internal cimport (
    Batch,
    Engine,
    Incoming,
    batch_add_cdr,
    batch_error,
    batch_free,
    name_strip,
    name_utf8,
    new_transform_stamped,
)
from tf2_ros._receive.recording cimport Recording, Records, records_add, records_add_malformed

from tf2_py._internal import counted

__all__ = ["Explained", "Source", "fill", "read_transforms"]

cdef enum:
    COUNT_EVERY = 256       # messages between two calls of `count`
    MOST_MESSAGES = 32      # that are inserted together ...
    MOST_TRANSFORMS = 32    # ... unless they have so many transforms


cdef class Explained:
    """
    An iterator over messages whose errors are explained; a generator would cost more per message.

    :param messages: gives tuples of a connection, the log time, and the data. A log time that does not fit
        into 64 bits, or data that are no bytes, are errors.
    :param explain: called with an ``Exception`` that was raised, and the log time of the last message before,
        or None. What it returns is raised instead; where that is None, the iteration ends.
    :param int least: fewer messages are an error, too.
    """

    cdef object _messages
    cdef object _explain
    cdef tuple _last            # message, or None
    cdef int64_t _missing

    def __cinit__(self, messages, explain, least=0):
        self._messages = iter(messages)
        self._explain = explain
        self._missing = min(least, INT64_MAX)   # a spoiled index may tell of any number

    def __iter__(self):
        return self

    def __next__(self):
        cdef tuple message
        try:
            message = next(self._messages)
            self._check(message)
            self._last = message
            self._missing -= 1
            return message
        except StopIteration:
            if self._missing <= 0:
                raise
            missing, self._missing = self._missing, 0
            self._raise(ValueError(f"{counted(missing, 'message')} of its index cannot be found in it"))
        except Exception as error:
            self._missing = 0
            self._raise(error)

    cdef int _check(self, tuple message) except -1:
        # A database may hold values of any type, and a damaged file any number.
        cdef int overflow = 0
        PyLong_AsLongLongAndOverflow(message[1], &overflow)
        if overflow:
            raise ValueError(f"a log time of {message[1]} ns does not fit into 64 bits")
        if not PyObject_CheckBuffer(message[2]):
            raise ValueError(f"a message is no bytes but {type(message[2]).__name__}")
        return 0

    cdef int _raise(self, error) except -1:
        explained = self._explain(error, None if self._last is None else self._last[1])
        if explained is None:
            raise StopIteration
        if explained is error:
            raise error
        raise explained from error


cdef class Source:
    """
    A topic whose transforms are wanted.

    :param str topic: its name, which is also the authority of its transforms.
    :param bool is_static: its transforms hold at all times.
    :param str prefix: of the names of its frames; without one they stay as they are.
    """

    cdef readonly str topic
    cdef str _prefix_text       # keeps _prefix alive
    cdef bint _is_static
    cdef const char* _authority
    cdef size_t _authority_size
    cdef const char* _prefix
    cdef size_t _prefix_size
    cdef char* _names           # the prefixed names of one message
    cdef size_t _capacity       # bytes of _names

    def __cinit__(self, str topic not None, bint is_static, str prefix not None=""):
        cdef Py_ssize_t size
        self.topic = topic
        self._is_static = is_static
        self._authority = name_utf8(topic, &size)
        self._authority_size = size
        self._prefix_text = prefix
        self._prefix = name_utf8(prefix, &size)
        self._prefix_size = size

    def __dealloc__(self):
        free(self._names)

    cdef bint read(self, Batch* batch, const Py_buffer* view) except -1:
        # As batch_add_cdr. With a prefix the batch must be empty; its names are valid until the next call.
        batch.is_static = self._is_static
        batch.authority = self._authority
        batch.authority_size = self._authority_size
        if not batch_add_cdr(batch, <const unsigned char*>view.buf, view.len):
            if batch.no_memory:
                raise MemoryError
            return False
        if self._prefix_size:
            self._add_prefix(batch)
        return True

    cdef int _add_prefix(self, Batch* batch) except -1:
        cdef Incoming* incoming
        cdef size_t i
        cdef size_t needed = 0
        cdef char* end
        for i in range(batch.count):
            incoming = &batch.entries[i].incoming
            needed += 2 * self._prefix_size + incoming.parent_size + incoming.child_size
        if needed > self._capacity:
            free(self._names)
            self._capacity = 0
            self._names = <char*>malloc(needed)
            if self._names == NULL:
                raise MemoryError
            self._capacity = needed
        end = self._names
        for i in range(batch.count):
            incoming = &batch.entries[i].incoming
            end = self._prefixed(end, &incoming.parent, &incoming.parent_size)
            end = self._prefixed(end, &incoming.child, &incoming.child_size)
        return 0

    cdef char* _prefixed(self, char* end, const char** name, size_t* size) noexcept:
        name_strip(name, size)
        if size[0] == 0:
            return end          # an empty name is refused, with a prefix or without
        memcpy(end, self._prefix, self._prefix_size)
        memcpy(end + self._prefix_size, name[0], size[0])
        name[0] = end
        size[0] += self._prefix_size
        return end + size[0]


def fill(Engine buffer not None, messages, sources, skip, *, count=None, Recording recording=None,
         list records=None):
    """
    Insert all transforms of raw messages.

    :param messages: an iterable of ``(connection, log time in ns, serialised TFMessage)``; ``connection`` has
        the name of its topic as ``topic``.
    :param sources: a :class:`Source` for each topic among them.
    :param skip: called with topic, log time and a ``ValueError`` for each message that cannot be read; what
        it raises ends the work.
    :param count: called now and then with the number of messages since the last call.
    :param recording: notes each transform, with the topic as publisher and the log time as time of reception.
    :param list records: receives what ``recording`` has no place for, array by array; the rest stays in it.
    :return: the number of messages.
    :raises KeyError: a topic has no source.

    What an iteration raises, also a KeyboardInterrupt, is passed on; what came before stays in the buffer.
    """
    cdef dict by_topic = {source.topic: source for source in sources}
    cdef dict by_connection = {}
    cdef Filling filling = Filling.__new__(Filling)
    cdef PyObject* last = NULL      # the latest connection, which by_connection keeps
    cdef size_t number = 0
    cdef size_t told = 0
    cdef tuple message
    filling.buffer = buffer
    filling.skip = skip
    filling.recording = recording
    filling.records = records
    try:
        for message in messages:
            connection = message[0]
            if <PyObject*>connection != last:
                kept = by_connection.get(id(connection))
                if kept is None:
                    kept = by_connection[id(connection)] = (connection, by_topic[connection.topic])
                filling.begin(<Source>(<tuple>kept)[1])
                last = <PyObject*>connection
            filling.add(message)
            number += 1
            if count is not None and number - told == COUNT_EVERY:
                count(number - told)
                told = number
    finally:
        filling.insert()
    if count is not None:
        count(number - told)
    return number


cdef class Filling:
    # A few messages of one source are inserted together: half of the cost of a small one is not its own.

    cdef Engine buffer
    cdef object skip
    cdef Recording recording    # or None
    cdef list records
    cdef Source source
    cdef bint alone             # each message is inserted by itself
    cdef Batch batch
    cdef Py_buffer views[MOST_MESSAGES]     # of the messages that the batch points into
    cdef size_t count                       # of views

    def __dealloc__(self):
        self.release()
        batch_free(&self.batch)

    cdef void release(self):
        while self.count:
            self.count -= 1
            PyBuffer_Release(&self.views[self.count])
        self.batch.count = 0

    cdef int begin(self, Source source) except -1:
        self.insert()
        self.source = source
        self.alone = self.recording is not None or source._prefix_size > 0
        return 0

    cdef int add(self, tuple message) except -1:
        cdef Py_buffer* view = &self.views[self.count]
        PyObject_GetBuffer(message[2], view, PyBUF_SIMPLE)
        self.count += 1
        if not self.source.read(&self.batch, view):
            if self.recording is not None:
                records_add_malformed(&self.recording._records)
            error = self.buffer.malformed(&self.batch, view.len)
            self.insert()
            self.skip(self.source.topic, message[1], error)
            return 0
        if self.recording is not None:
            self.note(message[1])
        if self.alone or self.count == MOST_MESSAGES or self.batch.count >= MOST_TRANSFORMS:
            self.insert()
        return 0

    cdef int note(self, int64_t log_ns) except -1:
        # Nobody else has this recording.
        cdef Records* noted = &self.recording._records
        if noted.count and noted.count + self.batch.count > noted.capacity:
            self.records.append(self.recording.take())
        records_add(noted, &self.batch, log_ns, <const unsigned char*>self.source._authority,
                    self.source._authority_size)
        return 0

    cdef int insert(self) except -1:
        try:
            if self.batch.count:
                self.buffer.insert(&self.batch)
                if self.batch.needs_report:
                    self.buffer.report(&self.batch, None)
        finally:
            self.release()
        return 0


def read_transforms(raw, Source source not None):
    """
    The transforms of one message.

    :param raw: a serialised TFMessage.
    :return: a list of ``geometry_msgs/TransformStamped``; where there is no ROS, of objects with its fields.
    :raises ValueError: it is malformed.
    """
    cdef Batch batch
    cdef Py_buffer view
    cdef const Incoming* incoming
    cdef size_t i
    cdef list transforms = []
    memset(&batch, 0, sizeof(Batch))
    PyObject_GetBuffer(raw, &view, PyBUF_SIMPLE)
    try:
        if not source.read(&batch, &view):
            raise batch_error(&batch, view.len)
        for i in range(batch.count):
            incoming = &batch.entries[i].incoming
            transforms.append(new_transform_stamped(
                &incoming.transform,
                incoming.stamp_ns,
                incoming.parent[:incoming.parent_size].decode(),
                incoming.child[:incoming.child_size].decode(),
            ))
        return transforms
    finally:
        batch_free(&batch)
        PyBuffer_Release(&view)
