"""
Measure side by side: entries take turns, round by round, and what they measure becomes rows.

A section declares entries, each a function that measures once a round; :meth:`Run.race` runs them all.
"""

from __future__ import annotations

import math
import os
import statistics
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.processes import ANSWER_S, CONTESTANTS, Failure, Library, Process, Refusal
from bench.sizes import Sizes
from bench.trees import Tree

OURS = "ours"
LOAD_S = 40.0  # a library that needs longer to load a tree does not take part
TIMED_S = 60.0  # a library that needs longer for calls within the budget leaves the race
CHECKED = 5  # answers that are compared with ours


@dataclass
class Sample:
    """What one library's calls of one kind took in one round: in ns for one transform, or in another unit."""

    who: str
    way: str
    labels: dict[str, Any]
    values: list[float]
    unit: str = "ns"
    failed: int = 0
    empty_ns: float = 0.0  # the loop without the call; subtracted already
    deviation: float | None = None  # largest difference between its answers and ours: m, or quaternion parts


@dataclass
class Entry:
    """One that takes its turn in a race."""

    who: str
    measure: Callable[[], Iterable[Sample]]


@dataclass
class Row:
    """
    All samples of one kind: percentiles of all values of all rounds, and in `rounds` each round's median.

    `labels` say what was measured: tree, hops, place in the history, ...
    """

    section: str
    who: str
    way: str
    labels: dict[str, Any]
    median: float
    p05: float
    p25: float
    p75: float
    p95: float
    rounds: list[float]
    unit: str = "ns"
    count: int = 0
    failed: int = 0
    empty_ns: float = 0.0
    deviation: float | None = None


class Rows(list[Row]):
    """All rows of a run."""

    def find(self, section: str, who: str, way: str, **labels: Any) -> Row | None:
        """The first row with these labels among its own; None if it was not measured."""
        return next(iter(self.all(section, who, way, **labels)), None)

    def all(self, section: str, who: str, way: str, **labels: Any) -> list[Row]:
        return [
            row
            for row in self
            if (row.section, row.who, row.way) == (section, who, way) and labels.items() <= row.labels.items()
        ]

    def median(self, section: str, who: str, way: str, **labels: Any) -> float:
        """NaN if it was not measured."""
        row = self.find(section, who, way, **labels)
        return math.nan if row is None else row.median

    def as_json(self) -> list[dict[str, Any]]:
        return [asdict(row) for row in self]


def row_of(section: str, samples: Sequence[Sample]) -> Row:
    first = samples[0]
    pooled = [value for sample in samples for value in sample.values]
    median, p05, p25, p75, p95 = np.quantile(pooled, (0.5, 0.05, 0.25, 0.75, 0.95)).tolist()
    return Row(
        section,
        first.who,
        first.way,
        first.labels,
        median,
        p05,
        p25,
        p75,
        p95,
        rounds=[statistics.median(sample.values) for sample in samples if sample.values],
        unit=first.unit,
        count=len(pooled),
        failed=sum(sample.failed for sample in samples),
        empty_ns=statistics.median(sample.empty_ns for sample in samples),
        deviation=first.deviation,
    )


@dataclass
class Run:
    """The libraries that take part, and what they have measured until now."""

    libraries: dict[str, Library]
    sizes: Sizes
    folder: Path
    say: Callable[[str], None]
    rows: Rows = field(default_factory=Rows)
    absent: list[dict[str, str]] = field(default_factory=list)
    _processes: dict[str, Process] = field(default_factory=dict)
    _ended: set[str] = field(default_factory=set)  # until they load another tree

    def __enter__(self) -> Run:
        # All at once: their imports take seconds.
        self._processes = {who: Process(library) for who, library in self.libraries.items()}
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes.values():
            process.end()

    def ask(self, who: str, *words: object, seconds: float = ANSWER_S) -> dict[str, Any]:
        if who in self._ended:
            raise Failure("it has ended before, and what it had loaded is lost")
        if who not in self._processes:
            self._processes[who] = Process(self.libraries[who])
        try:
            return self._processes[who].ask(*words, seconds=seconds)
        except Refusal:
            raise
        except Failure:
            self._processes.pop(who).end()
            self._ended.add(who)
            raise

    def restart(self, who: str) -> None:
        """Give the next order to a new process, whose memory has never been used."""
        self._ended.discard(who)
        if who in self._processes:
            self._processes.pop(who).end()

    @contextmanager
    def process(
        self, program: str, *arguments: str, who: str = OURS, environment: Mapping[str, str] = {}
    ) -> Iterator[Process]:
        """Another program of a library, in a ROS domain that hardly anyone else on this machine uses."""
        library = self.libraries[who]
        network = {"ROS_DOMAIN_ID": str(domain()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        command = [library.command[0], str(CONTESTANTS / program), *arguments]
        environment = {**library.environment, **network, **environment}
        process = Process(replace(library, command=command, environment=environment))
        try:
            yield process
        finally:
            process.end()

    def ways(self, keys: Iterable[str]) -> list[tuple[str, str]]:
        """(who, way) of every single lookup; ours first, because the others are compared with it."""
        return [(who, way) for who in keys for way in self.libraries[who].ways]

    @contextmanager
    def recording_failure(self, who: str, what: str) -> Iterator[None]:
        """A failure in here is recorded; the run continues."""
        try:
            yield
        except Failure as failure:
            reason = {"who": who, "what": what, "reason": str(failure)}
            if reason not in self.absent:
                self.absent.append(reason)

    def load(self, tree: Tree, keys: Iterable[str], keep: bool = False) -> list[str]:
        """
        Have libraries load a tree; those that did.

        :param keep: trees loaded before stay, and their sets of queries.
        """
        path = tree.write(self.folder)
        loaded = []
        for who in filter(self.libraries.__contains__, keys):
            self._ended.discard(who)
            with self.recording_failure(who, tree.name):
                self.ask(who, "load", path, int(keep), seconds=LOAD_S)
                loaded.append(who)
        return loaded

    def write(self, queries: np.ndarray) -> Path:
        """A file that processes read the next set of queries from."""
        path = self.folder / "queries"
        path.write_bytes(queries.tobytes())
        return path

    def prepare(
        self,
        section: str,
        labels: dict[str, Any],
        contenders: Iterable[tuple[str, str]],
        queries: np.ndarray,
        calls: int,
        per: int = 1,
        compared: bool = True,
    ) -> list[Entry]:
        """
        Hand each (who, way) the queries, compare the answers with ours, warm up; the entries of a race.

        :param per: transforms that one call looks up.
        :param compared: false where no library has an answer.
        """
        name, path = set_name(section, labels), self.write(queries)
        entries = []
        truth: list[list[float] | None] = []
        for who, way in contenders:
            with self.recording_failure(who, name):
                answers = self.ask(who, "prepare", way, name, path, CHECKED if compared else 0)["answers"]
                if who == OURS:
                    truth = truth or answers
                warm_up = self.sizes.warm_up if per == 1 else 2
                if not self.ask(who, "time", way, name, warm_up, self.sizes.budget_s, seconds=TIMED_S)["ns"]:
                    raise Failure("it has no answer to any of the queries")
                deviation = largest_deviation(truth, answers)
                entries.append(self.timed(who, way, labels, ("time", way, name, calls), per, deviation))
        return entries

    def timed(
        self,
        who: str,
        way: str,
        labels: dict[str, Any],
        order: Sequence[object],
        per: int = 1,
        deviation: float | None = None,
        process: Process | None = None,
    ) -> Entry:
        """An entry of one order, to which the budget is added; :func:`sample_of` reads its answer."""
        words = (*order, self.sizes.budget_s)

        def measure() -> list[Sample]:
            ask = partial(self.ask, who) if process is None else process.ask
            answer = ask(*words, seconds=TIMED_S)
            return [sample_of(answer, who, way, labels, per, deviation)]

        return Entry(who, measure)

    def race(self, section: str, entries: Sequence[Entry], rounds: int | None = None) -> None:
        """
        Run the entries in turn, each round beginning with another; add their rows.

        An entry that fails leaves the race without rows: every row has a sample of every round.
        """
        samples: list[list[Sample]] = [[] for _ in entries]
        running = list(range(len(entries)))
        for turn in range(rounds or self.sizes.rounds):
            for index in sorted(running, key=lambda index: (index - turn) % len(entries)):
                with self.recording_failure(entries[index].who, section):
                    samples[index] += entries[index].measure()
                    continue
                samples[index].clear()
                running.remove(index)
        rows: dict[tuple[str, str, str], list[Sample]] = {}
        for sample in (sample for own in samples for sample in own if sample.values):
            rows.setdefault((sample.who, sample.way, repr(sample.labels)), []).append(sample)
        self.rows.extend(row_of(section, own) for own in rows.values())


def sample_of(
    answer: dict[str, Any],
    who: str,
    way: str,
    labels: dict[str, Any],
    per: int = 1,
    deviation: float | None = None,
) -> Sample:
    """The ns of an answer, less the empty loop, for one transform; an insert's answer has their number."""
    batch = per * answer.get("batch", 1)
    values = [(ns - answer["empty_ns"]) / batch for ns in answer["ns"]]
    return Sample(who, way, labels, values, "ns", answer["failed"], answer["empty_ns"], deviation)


def p99(way: str) -> str:
    """The way of the rows that hold each round's 99th percentile."""
    return f"{way}, p99"


def with_p99(who: str, way: str, labels: dict[str, Any], values: list[float]) -> Iterator[Sample]:
    """Two samples: all values, and their 99th percentile."""
    yield Sample(who, way, labels, values)
    yield Sample(who, p99(way), labels, [np.quantile(values, 0.99).item()])


def set_name(section: str, labels: dict[str, Any]) -> str:
    """What a set of queries is called, beside the way of looking up."""
    return "/".join(map(str, (section, *labels.values())))


def domain() -> int:
    return 60 + os.getpid() % 40


def largest_deviation(
    truth: Sequence[Sequence[float] | None], answers: Sequence[Sequence[float] | None]
) -> float | None:
    """Largest difference, in m or of a quaternion's component; None where nothing compares."""
    differences = []
    for ours, theirs in zip(truth, answers, strict=False):
        if ours is not None and theirs is not None:
            a, b = np.array(ours), np.array(theirs)
            if a[3:] @ b[3:] < 0:
                b[3:] *= -1  # q and -q are one rotation
            differences.append(float(np.abs(a - b).max()))
    return max(differences, default=None)
