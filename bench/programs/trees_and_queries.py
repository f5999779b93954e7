# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Trees and queries for lookups, the same in every process and every run."""

import functools
import itertools
import random

import numpy as np

START_NS = 1_700_000_000 * 10**9
PERIOD_NS = 10_000_000  # 100 Hz
JITTER_NS = 1_000_000  # real stamps are not equally spaced
CACHE_S = 60.0
CHUNK = 4096  # records that become Python objects at a time
# tf2_cpp.cpp has the same structs.
RECORD = np.dtype(
    [
        ("child", "u4"),
        ("parent", "u4"),
        ("static", "u4"),
        ("reserved", "u4"),
        ("stamp_ns", "i8"),
        ("pose", "f8", 7),
    ]
)
QUERY = np.dtype([("target", "u4"), ("source", "u4"), ("time_ns", "i8")])


class Tree:
    """
    Frames by index. A frame that is its own parent is a root; frame 0 is one.

    :param samples: of every dynamic frame.
    :param turns_at_random: each sample has a random rotation; otherwise frames turn smoothly.
    """

    def __init__(self, name, parents, dynamic, samples, cache_s=CACHE_S, turns_at_random=False):
        self.name, self.parents, self.dynamic, self.samples = name, parents, dynamic, samples
        self.turns_at_random = turns_at_random
        self.cache_ns = round(cache_s * 1e9)
        self.names = ["world"] + [f"frame_{i:05}" for i in range(1, len(parents))]
        self.links = [(child, parent) for child, parent in enumerate(parents) if child != parent]

    @functools.cached_property
    def records(self):
        """RECORD of each transform in the order of their stamps, static ones first."""
        numbers = np.random.default_rng(7)
        links = np.array(self.links)
        moving = np.array(self.dynamic)[links[:, 0]]
        static = _static_records(links[~moving], numbers)
        samples = _histories(links[moving], self.samples, numbers).reshape(-1)
        if self.turns_at_random:
            samples["pose"][:, 3:] = _normalized(numbers.normal(size=(len(samples), 4)))
        return np.concatenate([static, samples[np.argsort(samples["stamp_ns"], kind="stable")]])

    @functools.cached_property
    def span_ns(self):
        """The oldest and the newest stamp at which every dynamic frame has data."""
        moving = self.records[self.records["static"] == 0]
        if not len(moving):
            return START_NS, START_NS
        frames = sum(self.dynamic)
        stamps = moving["stamp_ns"][np.lexsort((moving["stamp_ns"], moving["child"]))].reshape(frames, -1)
        return int(stamps[:, 0].max()), int(stamps[:, -1].min())

    @property
    def newest_ns(self):
        return self.span_ns[1]

    def transforms(self):
        """(child, parent, static, stamp in ns, pose) of each transform, as Python objects."""
        names = self.names
        for start in range(0, len(self.records), CHUNK):
            part = self.records[start : start + CHUNK]
            columns = (part[name].tolist() for name in ("child", "parent", "static", "stamp_ns", "pose"))
            for child, parent, static, stamp_ns, pose in zip(*columns, strict=True):
                yield names[child], names[parent], bool(static), stamp_ns, pose

    def pairs(self, hops, count, seed=1):
        """Random (target, source), exactly `hops` links apart; one of these dynamic, if any link is."""
        dice = random.Random(seed)
        neighbors = [[] for _ in self.parents]
        for child, parent in self.links:
            neighbors[child].append(parent)
            neighbors[parent].append(child)
        found = []
        for _ in range(1000 * count):
            if len(found) == count:
                break
            source = dice.randrange(len(self.parents))
            reached, moves = [source], {source: not any(self.dynamic)}  # whether a link on the way moves
            for _ in range(hops):
                links = [(frame, one) for frame in reached for one in neighbors[frame] if one not in moves]
                for frame, one in links:
                    moves[one] = moves[frame] or self.dynamic[one if self.parents[one] == frame else frame]
                reached = [one for _, one in links]
            if targets := [frame for frame in reached if moves[frame]]:
                found.append((dice.choice(targets), source))
        if len(found) < count:
            raise ValueError(f"{self.name} has too few pairs {hops} hops apart")
        return found

    def times(self, place, count, seed=1):
        """Times of lookups: `static` or `latest`, `newest`, `oldest`, `sorted`; or else random ones."""
        oldest_ns, newest_ns = self.span_ns
        fixed = {"static": 0, "latest": 0, "newest": newest_ns, "oldest": oldest_ns}
        if place in fixed:
            return np.full(count, fixed[place])
        times = np.random.default_rng(seed).integers(oldest_ns, newest_ns, count, endpoint=True)
        return np.sort(times) if place == "sorted" else times

    def queries(self, pairs, times_ns):
        """(target, source, time in ns) of each time, with the pairs in turn."""
        in_turn = zip(itertools.cycle(pairs), times_ns.tolist(), strict=False)
        return [(self.names[target], self.names[source], ns) for (target, source), ns in in_turn]

    def vector_queries(self, pairs, place, count):
        """The same with a run of so many times for each pair: one vector lookup each."""
        return [
            query
            for seed, pair in enumerate(pairs, start=count)
            for query in self.queries([pair], self.times(place, count, seed))
        ]


def _static_records(links, numbers):
    records = np.zeros(len(links), RECORD)
    records["child"], records["parent"], records["static"] = *links.T, 1
    records["pose"][:, :3] = numbers.uniform(-5, 5, (len(links), 3))
    records["pose"][:, 3:] = _normalized(numbers.normal(size=(len(links), 4)))
    return records


def _histories(links, count, numbers):
    """A row of records for each frame, which moves smoothly and turns about one axis at up to 1 rad/s."""
    column = len(links), 1
    records = np.zeros((len(links), count), RECORD)
    records["child"], records["parent"] = links.T[:, :, None]
    phase = numbers.integers(PERIOD_NS, size=column)
    jitter = numbers.integers(-JITTER_NS, JITTER_NS, records.shape)
    records["stamp_ns"] = START_NS + phase + np.arange(count) * PERIOD_NS + jitter
    seconds = (records["stamp_ns"] - START_NS) / 1e9
    half = (numbers.uniform(-3, 3, column) + numbers.uniform(-1, 1, column) * seconds) / 2
    for axis in range(3):
        frequency = numbers.uniform(0.1, 1, column)
        records["pose"][..., axis] = numbers.uniform(-5, 5, column) + np.sin(seconds * frequency)
    turning_axis = _normalized(numbers.normal(size=(len(links), 1, 3)))
    records["pose"][..., 3:6] = np.sin(half)[..., None] * turning_axis
    records["pose"][..., 6] = np.cos(half)
    return records


def _normalized(rows):
    return rows / np.linalg.norm(rows, axis=-1, keepdims=True)


def bushy(name, frames, dynamic_share, samples, cache_s=CACHE_S):
    """A tree whose every frame has a random earlier one as parent; the root is frame 0."""
    dice = random.Random(3)
    parents = [0] + [dice.randrange(child) for child in range(1, frames)]
    moving = set(dice.sample(range(1, frames), round(dynamic_share * (frames - 1))))
    return Tree(name, parents, [frame in moving for frame in range(frames)], samples, cache_s)


def chain(name, links, samples, moving=None, turns_at_random=False):
    """A chain below the root, whose first frames (None: all) are dynamic."""
    parents = [0, *range(links)]
    last = links if moving is None else moving
    dynamic = [0 < frame <= last for frame in range(links + 1)]
    return Tree(name, parents, dynamic, samples, samples / 100 + CACHE_S, turns_at_random)
