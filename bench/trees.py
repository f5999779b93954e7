"""Trees and queries for lookups, the same in every run."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

START_NS = 1_700_000_000 * 10**9
PERIOD_NS = 10_000_000  # 100 Hz
JITTER_NS = 1_000_000  # real stamps are not equally spaced
LATEST = 0
CACHE_S = 60.0

# serving.RECORD and serving.QUERY, for arrays
RECORD = np.dtype(
    [
        ("child", "<u4"),
        ("parent", "<u4"),
        ("static", "<u4"),
        ("reserved", "<u4"),
        ("stamp_ns", "<i8"),
        ("pose", "<f8", 7),
    ]
)
QUERY = np.dtype([("target", "<u4"), ("source", "<u4"), ("time_ns", "<i8")])


@dataclass
class Tree:
    """
    Frames by index. A frame that is its own parent is a root; frame 0 is one.

    Every dynamic frame has `samples` samples.
    """

    name: str
    parents: list[int]
    dynamic: list[bool]
    samples: int = 0
    cache_s: float = CACHE_S
    first_ns: int = START_NS
    newest_ns: int = START_NS
    names: list[str] = field(init=False)

    def __post_init__(self) -> None:
        self.names = ["world"] + [f"frame_{i:05}" for i in range(1, len(self.parents))]

    @property
    def moves(self) -> bool:
        return any(self.dynamic)

    def links(self) -> list[tuple[int, int]]:
        """(child, parent) of every frame that is no root."""
        return [(child, parent) for child, parent in enumerate(self.parents) if child != parent]

    def write(self, folder: Path) -> Path:
        """Write the transforms in the order of their stamps, static ones first; sets the common times."""
        path = folder / f"{self.name}.tree"
        numbers = np.random.default_rng(7)
        links = np.array(self.links())
        moving = np.array(self.dynamic)[links[:, 0]]
        static = _static_records(links[~moving], numbers)
        histories = _histories(links[moving], self.samples, numbers)
        if histories.size:
            self.first_ns = int(histories["stamp_ns"][:, 0].max())
            self.newest_ns = int(histories["stamp_ns"][:, -1].min())
        samples = histories.reshape(-1)
        records = np.concatenate([static, samples[np.argsort(samples["stamp_ns"], kind="stable")]])
        with path.open("wb") as file:
            facts = len(self.names), len(records), round(self.cache_s * 1e9), self.newest_ns
            file.write("".join(f"{line}\n" for line in (" ".join(map(str, facts)), *self.names)).encode())
            file.write(records.tobytes())
        return path

    def pairs(self, hops: int, count: int, seed: int, must_move: bool) -> list[tuple[int, int]]:
        """Random (target, source), exactly `hops` links apart; one of them dynamic if `must_move`."""
        dice = random.Random(seed)
        neighbours: list[list[int]] = [[] for _ in self.parents]
        for child, parent in self.links():
            neighbours[child].append(parent)
            neighbours[parent].append(child)
        found: list[tuple[int, int]] = []
        for _ in range(1000 * count):
            if len(found) == count:
                break
            source = dice.randrange(len(self.parents))
            reached, moves = [source], {source: False}  # by so many hops; whether a link on the way moves
            for _ in range(hops):
                next_reached = []
                for frame in reached:
                    for neighbour in neighbours[frame]:
                        if neighbour not in moves:
                            child = neighbour if self.parents[neighbour] == frame else frame
                            moves[neighbour] = moves[frame] or self.dynamic[child]
                            next_reached.append(neighbour)
                reached = next_reached
            targets = [frame for frame in reached if moves[frame] or not must_move]
            if targets:
                found.append((dice.choice(targets), source))
        if len(found) < count:
            raise ValueError(f"{self.name} has too few pairs {hops} hops apart")
        return found

    def random_times(self, count: int, seed: int) -> np.ndarray:
        return np.random.default_rng(seed).integers(self.first_ns, self.newest_ns, count, endpoint=True)


def _static_records(links: np.ndarray, numbers: np.random.Generator) -> np.ndarray:
    count = len(links)
    records = np.zeros(count, RECORD)
    records["child"], records["parent"], records["static"] = *links.T, 1
    records["pose"][:, :3] = numbers.uniform(-5, 5, (count, 3))
    records["pose"][:, 3:] = _normalized(numbers.normal(size=(count, 4)))
    return records


def _histories(links: np.ndarray, count: int, numbers: np.random.Generator) -> np.ndarray:
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


def _normalized(rows: np.ndarray) -> np.ndarray:
    return rows / np.linalg.norm(rows, axis=-1, keepdims=True)


def bushy(name: str, frames: int, dynamic_share: float, samples: int) -> Tree:
    """A tree whose every frame has a random earlier one as parent; the root is frame 0."""
    dice = random.Random(3)
    parents = [0] + [dice.randrange(child) for child in range(1, frames)]
    moving = set(dice.sample(range(1, frames), round(dynamic_share * (frames - 1))))
    return Tree(name, parents, [frame in moving for frame in range(frames)], samples)


def chain(name: str, hops: int, samples: int) -> Tree:
    """A chain of dynamic frames below the root."""
    frames = range(hops + 1)
    return Tree(
        name,
        [max(0, frame - 1) for frame in frames],
        [frame > 0 for frame in frames],
        samples,
        max(CACHE_S, samples / 100 + 2),
    )


def fork(name: str, ancestors: int, samples: int) -> Tree:
    """A chain of dynamic frames that ends in two branches of two links: the last two frames are the tips."""
    top = ancestors
    parents = [max(0, frame - 1) for frame in range(top + 1)] + [top, top, top + 1, top + 2]
    return Tree(name, parents, [frame > 0 for frame in range(len(parents))], samples)


def queries_of(pairs: Sequence[tuple[int, int]], times_ns: np.ndarray) -> np.ndarray:
    """One query for each time; the pairs in turn."""
    return _queries(np.resize(np.array(pairs), (len(times_ns), 2)), times_ns)


def vector_queries_of(pairs: Sequence[tuple[int, int]], times_ns: Sequence[np.ndarray]) -> np.ndarray:
    """For each pair its own run of times: one vector lookup each."""
    return _queries(
        np.repeat(np.array(pairs), [len(run) for run in times_ns], axis=0), np.concatenate(times_ns)
    )


def _queries(pairs: np.ndarray, times_ns: np.ndarray) -> np.ndarray:
    queries = np.zeros(len(times_ns), QUERY)
    queries["target"], queries["source"], queries["time_ns"] = *pairs.T, times_ns
    return queries
