# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Readers of a stress run: they ask a buffer in all ways, and check each answer."""

import pickle

import numpy as np

from reliability.stress_truth import ADDED, CACHE_S, FRAMES, PAIRS, S, check, check_message, stamp_ns
from tf2_ros import TransformException

TIMES = 300  # of one vector lookup
SPAN_NS = round(1.2 * CACHE_S * S)  # a little more than the buffer keeps


class Reader:
    """One reader of a buffer; ``counts`` shows how many answers it has checked, by kind."""

    def __init__(self, buffer, rng):
        self.buffer, self._rng = buffer, rng
        self.counts = dict.fromkeys(("single", "two times", "vector", "listing", "pickle", "unanswered"), 0)
        self._ways = [self.ask_latest] * 8 + [self.ask_past] * 8 + [self.ask_two_times] * 3
        self._ways += [self.ask_many] * 6 + [self.list_all] * 2 + [self.travel]

    def step(self):
        """Ask once, in a way that is drawn by lot."""
        try:
            self._rng.choice(self._ways)(*self._rng.choice(PAIRS))
        except TransformException:
            self.counts["unanswered"] += 1

    def _time(self, target, source):
        newest_ns = self.buffer.get_latest_common_time(target, source).nanoseconds
        return newest_ns, max(1, newest_ns - self._rng.randrange(SPAN_NS))

    def ask_latest(self, target, source):
        answer = self.buffer.lookup_transform_core(target, source, 0)
        if stamp_ns(answer):  # otherwise both are static
            check_message(target, source, answer)
            self.counts["single"] += 1

    def ask_past(self, target, source):
        _, time_ns = self._time(target, source)
        check_message(target, source, self.buffer.lookup_transform_core(target, source, time_ns), time_ns)
        self.counts["single"] += 1

    def ask_two_times(self, target, source):
        """Source at one time, target at another; the world does not move."""
        newest_ns, time_ns = self._time(target, source)
        there = self.buffer.lookup_transform_full_core(target, newest_ns, "world", time_ns, "world")
        check_message(target, "world", there, newest_ns)
        self.counts["two times"] += 1

    def ask_many(self, target, source):
        newest_ns, _ = self._time(target, source)
        if newest_ns == 0:
            return
        times_ns = newest_ns - np.array([self._rng.randrange(SPAN_NS) for _ in range(TIMES)], np.int64)
        translations, rotations = self.buffer.lookup_transforms(target, source, times_ns, on_missing="nan")
        found = np.isfinite(translations).all(axis=1)
        assert np.isnan(translations[~found]).all() and np.isnan(rotations[~found]).all(), "half of an answer"
        check(target, source, times_ns[found], translations[found], rotations[found])
        self.counts["vector"] += int(found.sum())

    def list_all(self, *_):
        facts = self.buffer.frames()
        unknown = {name for name in facts if name not in FRAMES and not name.startswith(ADDED)}
        assert not unknown, unknown
        for name, one in facts.items():
            assert one.oldest_ns is None or one.oldest_ns <= one.newest_ns, (name, one)
        self.buffer.all_frames_as_yaml()
        self.buffer.tree()
        self.buffer.all_frames_as_string()
        self.counts["listing"] += 1

    def travel(self, *_):
        """A copy is as of one moment, whole, and answers right."""
        copy = pickle.loads(pickle.dumps(self.buffer))
        copy._self_check()
        reader = Reader(copy, self._rng)
        for way in (reader.ask_latest, reader.ask_many):
            try:
                way(*self._rng.choice(PAIRS))
            except TransformException:
                continue
        self.counts["pickle"] += 1
