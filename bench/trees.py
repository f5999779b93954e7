"""Owns the trees that lookups are measured on, and the questions asked of them; the same in every run."""

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
    """Frames by index; frame 0 is the root. Dynamic frames carry as many samples as `samples` says."""

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

    def write(self, folder: Path) -> Path:
        """Write the transforms in the order of their stamps, static ones first; sets the common times."""
        path = folder / f"{self.name}.tree"
        numbers = np.random.default_rng(7)
        static = [
            _static_record(child, self.parents[child], numbers)
            for child in range(1, len(self.parents))
            if not self.dynamic[child]
        ]
        histories = [
            self._history(child, numbers) for child in range(1, len(self.parents)) if self.dynamic[child]
        ]
        if histories:
            self.first_ns = max(int(history["stamp_ns"][0]) for history in histories)
            self.newest_ns = min(int(history["stamp_ns"][-1]) for history in histories)
        moving = np.concatenate(histories) if histories else np.empty(0, RECORD)
        moving = moving[np.argsort(moving["stamp_ns"], kind="stable")]
        with path.open("wb") as file:
            count = len(static) + len(moving)
            file.write(f"{len(self.names)} {count} {round(self.cache_s * 1e9)} {self.newest_ns}\n".encode())
            file.write("".join(name + "\n" for name in self.names).encode())
            for record in static:
                file.write(record.tobytes())
            file.write(moving.tobytes())
        return path

    def _history(self, child: int, numbers: np.random.Generator) -> np.ndarray:
        """A frame that wanders smoothly and turns about one axis at up to 1 rad/s."""
        count = self.samples
        history = np.zeros(count, RECORD)
        history["child"], history["parent"] = child, self.parents[child]
        phase = int(numbers.integers(PERIOD_NS))
        jitter = numbers.integers(-JITTER_NS, JITTER_NS, count)
        history["stamp_ns"] = START_NS + phase + np.arange(count) * PERIOD_NS + jitter
        seconds = (history["stamp_ns"] - START_NS) / 1e9
        axis = numbers.normal(size=3)
        axis /= np.linalg.norm(axis)
        half = (numbers.uniform(-3, 3) + numbers.uniform(-1, 1) * seconds) / 2
        history["pose"][:, :3] = numbers.uniform(-5, 5, 3) + np.sin(
            seconds[:, None] * numbers.uniform(0.1, 1, 3)
        )
        history["pose"][:, 3:6] = np.sin(half)[:, None] * axis
        history["pose"][:, 6] = np.cos(half)
        return history

    def pairs(self, hops: int, count: int, seed: int, must_move: bool) -> list[tuple[int, int]]:
        """Random (target, source), exactly `hops` links apart; one of them dynamic if `must_move`."""
        dice = random.Random(seed)
        neighbours: list[list[int]] = [[] for _ in self.parents]
        for child, parent in enumerate(self.parents[1:], start=1):
            neighbours[child].append(parent)
            neighbours[parent].append(child)
        found: list[tuple[int, int]] = []
        for _ in range(1000 * count):
            if len(found) == count:
                break
            source = dice.randrange(len(self.parents))
            ring, seen, moves = [source], {source}, {source: False}
            for _ in range(hops):
                outer = []
                for near in ring:
                    for far in neighbours[near]:
                        if far not in seen:
                            seen.add(far)
                            child = far if self.parents[far] == near else near
                            moves[far] = moves[near] or self.dynamic[child]
                            outer.append(far)
                ring = outer
            ring = [target for target in ring if moves[target] or not must_move]
            if ring:
                found.append((dice.choice(ring), source))
        if len(found) < count:
            raise ValueError(f"{self.name} has too few pairs {hops} hops apart")
        return found

    def random_times(self, count: int, seed: int) -> np.ndarray:
        return np.random.default_rng(seed).integers(self.first_ns, self.newest_ns, count, endpoint=True)


def _static_record(child: int, parent: int, numbers: np.random.Generator) -> np.ndarray:
    record = np.zeros((), RECORD)
    rotation = numbers.normal(size=4)
    record["child"], record["parent"], record["static"] = child, parent, 1
    record["pose"] = (*numbers.uniform(-5, 5, 3), *(rotation / np.linalg.norm(rotation)))
    return record


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


def write_queries(path: Path, pairs: Sequence[tuple[int, int]], times_ns: np.ndarray) -> Path:
    """One query for each time; pairs go round."""
    sides = np.resize(np.array(pairs), (len(times_ns), 2))
    return _write(path, sides[:, 0], sides[:, 1], times_ns)


def write_vector_queries(
    path: Path, pairs: Sequence[tuple[int, int]], times_ns: Sequence[np.ndarray]
) -> Path:
    """For each pair its own run of times: one vector lookup each."""
    sides = np.repeat(np.array(pairs), [len(run) for run in times_ns], axis=0)
    return _write(path, sides[:, 0], sides[:, 1], np.concatenate(times_ns))


def _write(path: Path, targets: np.ndarray, sources: np.ndarray, times_ns: np.ndarray) -> Path:
    queries = np.zeros(len(times_ns), QUERY)
    queries["target"], queries["source"], queries["time_ns"] = targets, sources, times_ns
    path.write_bytes(queries.tobytes())
    return path
