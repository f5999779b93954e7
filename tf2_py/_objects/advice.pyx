"""Owns what error texts say of unknown names and of silent topics, and for how long it is remembered."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint64_t

from tf2_py._core.clock cimport monotonic_ns

from tf2_py._objects.closest import LONGEST, closest
from tf2_py._objects.errors import bad_name
from tf2_py._objects.printable import printable

cdef enum:
    MOST_COMPARED = 4000        # known names: comparing takes some 2 us for each, with the GIL held
    MOST_REMEMBERED = 64        # texts
    SHARE = 50                  # one part in so many of the time may be spent on comparing names ...

cdef int64_t MOST_DEBT_NS = 50000000        # ... after so much has been spent
cdef int64_t SILENCE_NS = 100000000         # how often the topics are looked at while nothing is new


cdef class Advice:
    """What the errors of one buffer say beyond what has failed."""

    def __cinit__(self):
        self._silence = ("", "")
        self._texts = {}
        self._suggestions = {}

    cdef int ask(self, object find_silence) except -1:
        self._find_silence = find_silence
        self._silence_until_ns = 0
        return 0

    cdef int begin(self, object buffer, size_t count) except -1:
        cdef int64_t now_ns
        if self._find_silence is not None:
            now_ns = monotonic_ns()
            # New names were received on some topic.
            if now_ns >= self._silence_until_ns or count != self._count:
                self._look_for_silence(buffer, now_ns)
        if count != self._count:
            self._count = count
            self._forget_texts()
        return 0

    cdef str unknown(self, str name, str argument, str call, object list_names):
        cdef tuple key = (call, argument, name)
        cdef uint64_t version = self._version
        text = self._texts.get(key)
        if text is not None:
            return text
        suggestion = self.suggestion(name, list_names)
        text = str(bad_name(name, argument, call))
        for sentence in (suggestion, self._state()):
            if sentence:
                text += f"{'' if text.endswith('?') else '.'} {sentence}"
        # Meanwhile another thread may have begun with other facts. None: it is not known yet.
        if version == self._version and suggestion is not None and len(name) <= LONGEST:
            _remember(self._texts, key, text)
        return text

    cdef str suggestion(self, str name, object list_names):
        cdef size_t count = self._count
        cdef uint64_t version = self._version
        cdef int64_t start_ns
        if count == 0 or count > MOST_COMPARED or len(name) > LONGEST:
            return ""
        known = self._suggestions.get(name)
        if known is not None and known[0] == count:
            return known[1]
        start_ns = monotonic_ns()
        if not self._may_compare(start_ns):
            return None
        found = closest(name, list_names())
        self._debt_ns += monotonic_ns() - start_ns
        text = f"Did you mean {' or '.join([f'[{printable(one)}]' for one in found])}?" if found else ""
        if version == self._version:
            _remember(self._suggestions, name, (count, text))
        return text

    cdef object with_silence(self, object error, object buffer, bint dynamic_only):
        if self._silence[dynamic_only]:
            # The error tells what the buffer holds now, and must not contradict itself.
            self._look_for_silence(buffer, monotonic_ns())
        silence = self._silence[dynamic_only]
        if not silence:
            return error
        text = str(error)
        added = f" {_sentence(silence)}" if text.endswith(".") else f"; {silence}"
        return type(error)(text + added)

    cdef int forget(self) except -1:
        self._suggestions.clear()
        self._forget_texts()
        return 0

    cdef int _look_for_silence(self, object buffer, int64_t now_ns) except -1:
        self._silence_until_ns = now_ns + SILENCE_NS
        silence = self._find_silence(buffer)
        if silence != self._silence:
            self._silence = silence
            self._forget_texts()
        return 0

    cdef int _forget_texts(self) except -1:
        self._version += 1
        self._texts.clear()
        return 0

    cdef str _state(self):
        silence = self._silence[0]
        if self._count == 0:
            return f"The buffer is empty: {silence}" if silence else "The buffer is empty"
        return _sentence(silence)

    cdef bint _may_compare(self, int64_t now_ns):
        # So that programs that look up ever new names, or while frames appear, spend no more on advice.
        self._debt_ns = max(0, self._debt_ns - (now_ns - self._debt_at_ns) // SHARE)
        self._debt_at_ns = now_ns
        return self._debt_ns < MOST_DEBT_NS


cdef str _sentence(str clause):
    return clause[:1].upper() + clause[1:]


cdef int _remember(dict known, object key, object value) except -1:
    if len(known) >= MOST_REMEMBERED:
        known.clear()
    known[key] = value
    return 0
