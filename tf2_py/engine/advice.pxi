# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What error texts say of unknown names and of silent topics."""

cdef enum:
    MOST_COMPARED = 200         # known names: comparing takes some 20 us for each, with the GIL held
    MOST_REMEMBERED = 64        # suggestions, and frames whose transforms were refused

cdef int64_t SILENCE_NS = 100000000         # how often the topics are checked while nothing is new


cdef class Advice:
    """What the errors of one buffer say beyond what has failed."""

    def __cinit__(self):
        self._silence = ("", "")
        self._suggestions, self._refusals = {}, {}

    cdef int describe_silence_with(self, object find_silence) except -1:
        self._find_silence = find_silence
        self._silence_until_ns = 0
        return 0

    cdef int begin(self, object buffer, size_t count) except -1:
        # New names were received on some topic.
        if count != self._count:
            self.forget()
        self._count = count
        if monotonic_ns() >= self._silence_until_ns:
            self._look_for_silence(buffer)
        return 0

    cdef str extend(self, str text, str name, object list_names):
        for sentence in (self.suggestion(name, list_names), self._refusals.get(name), self._state()):
            if sentence:
                text += f"{'' if text.endswith('?') else '.'} {sentence}"
        return text

    cdef str suggestion(self, str name, object list_names):
        # If the names change meanwhile, this dict is not used any more.
        cdef dict suggestions = self._suggestions
        if self._count == 0:
            return ""
        if self._count > MOST_COMPARED:
            return f"With more than {MOST_COMPARED} frames, no similar names are suggested"
        if name not in suggestions:
            found = frame_names.closest(name, list_names())
            text = f"Did you mean {' or '.join([f'[{printable(one)}]' for one in found])}?" if found else ""
            if len(suggestions) >= MOST_REMEMBERED:
                suggestions.clear()
            suggestions[name] = text
        return suggestions[name]

    cdef int remember_refused(self, str child, uint32_t reasons) except -1:
        if len(self._refusals) >= MOST_REMEMBERED:
            self._refusals.clear()
        because = log.because(reasons)
        self._refusals[child] = f"Transforms of [{printable(child)}] were refused, because {because}"
        return 0

    cdef object with_silence(self, object error, object buffer, bint dynamic_only):
        if self._silence[dynamic_only]:
            # The error describes the present content of the buffer, and must not contradict itself.
            self._look_for_silence(buffer)
        silence = self._silence[dynamic_only]
        if not silence:
            return error
        text = str(error)
        added = f" {_sentence(silence)}" if text.endswith((".", "?")) else f"; {silence}"
        return type(error)(text + added)

    cdef int forget(self) except -1:
        self._suggestions = {}
        self._silence_until_ns = 0
        return 0

    cdef int _look_for_silence(self, object buffer) except -1:
        self._silence_until_ns = monotonic_ns() + SILENCE_NS
        if self._find_silence is not None:
            self._silence = self._find_silence(buffer)
        return 0

    cdef str _state(self):
        silence = self._silence[0]
        if self._count == 0:
            return f"The buffer is empty: {silence}" if silence else "The buffer is empty"
        return _sentence(silence)


cdef str _sentence(str clause):
    return clause[:1].upper() + clause[1:]
