# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Which samples have answered a lookup of the model."""

import math
from typing import NamedTuple

from model_terms import NEWEST


class ModelHop(NamedTuple):
    """As Hop of tf2_py, but its transform is the stamp, x y z and x y z w."""

    frame: str
    parent: str
    direction: str
    how: str
    older_ns: int | None
    newer_ns: int | None
    weight: float
    gap: float
    age: float | None
    last_authority: str
    transform: tuple


class Explanations:
    """Of a model, which has `frames`, `authorities`, `now_ns`, and lookups under a policy."""

    def explain(self, policy, target, source, ns):
        """The answer, the time that was looked up, the hops."""
        answer = self.lookup_under(policy, target, source, ns)
        if target == source:
            return answer, answer[0], []
        time, _, chain, top = self._walk_asked(target, source, ns, policy)
        hops = [
            self._hop(name, "up" if i < top else "down", time, policy)
            for i, name in enumerate(chain)
            if i != top
        ]
        return answer, time, hops

    def _hop(self, name, direction, time, policy):
        frame = self.frames[name]
        parent, transform = self.data_at(name, time or NEWEST, policy)
        how, older, newer, gap_ns = samples_at(frame, time, policy.extrapolate)
        used_ns, carried_on = frame.used_ns(name, time, policy)
        weight = (time - older) / (newer - older) if how in ("interpolated", "extrapolated") else 0.0
        age = None
        if self.now_ns is not None and not frame.static:
            age = math.inf if self.now_ns <= 0 else (self.now_ns - frame.newest_ns()) / 1e9
        stamp = time if carried_on else used_ns
        return ModelHop(
            name,
            parent,
            direction,
            how,
            older,
            newer,
            weight,
            gap_ns / 1e9,
            age,
            self.authorities[name],
            (stamp, *transform),
        )


def samples_at(frame, time, extrapolate):
    """How a frame answers, the stamps of the samples, and the gap, all times in ns."""
    if frame.static:
        return "static", None, None, 0
    stamps, newest_ns = [sample[0] for sample in frame.samples], frame.newest_ns()
    if time > newest_ns:
        before, last = frame.samples[-2:] if len(stamps) > 1 else frame.samples * 2
        if extrapolate and before[0] != last[0] and before[1] == last[1]:
            return "extrapolated", before[0], last[0], time - newest_ns
        return "held", newest_ns, newest_ns, time - newest_ns
    if time in stamps:
        return "sample", time, time, 0
    older = [sample for sample in frame.samples if sample[0] < time][-1]
    newer = [sample for sample in frame.samples if sample[0] > time][0]
    how = "interpolated" if older[1] == newer[1] else "kept"
    return how, older[0], newer[0], newer[0] - older[0]
