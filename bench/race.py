"""
Owns measuring side by side: entries take turns, round by round, and what they measure becomes rows.

A section declares entries, each a function that measures once a round; :meth:`Arena.race` runs them all.
"""

from __future__ import annotations

import os
import statistics
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from bench.processes import CONTESTANTS, Failure, Library, Process, Refusal
from bench.sizes import Sizes
from bench.trees import Tree

OURS = "ours"
LOAD_S = 40.0  # a library that needs longer to load a tree does not take part
ORDER_S = 60.0
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

    def ratio_to(self, other: Row) -> float:
        """The median of the rounds' ratios: in a race, a disturbance of a round affects both."""
        return statistics.median(a / b for a, b in zip(self.rounds, other.rounds, strict=True))


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

    def as_json(self) -> list[dict[str, Any]]:
        return [asdict(row) for row in self]


def percentile(ordered: Sequence[float], share: float) -> float:
    """By linear interpolation between the two nearest ranks."""
    rank = share * (len(ordered) - 1)
    low = int(rank)
    high = min(low + 1, len(ordered) - 1)
    return ordered[low] + (rank - low) * (ordered[high] - ordered[low])


def row_of(section: str, samples: Sequence[Sample]) -> Row:
    first = samples[0]
    pooled = sorted(value for sample in samples for value in sample.values)
    return Row(
        section,
        first.who,
        first.way,
        first.labels,
        *(percentile(pooled, share) for share in (0.5, 0.05, 0.25, 0.75, 0.95)),
        rounds=[statistics.median(sample.values) for sample in samples if sample.values],
        unit=first.unit,
        count=len(pooled),
        failed=sum(sample.failed for sample in samples),
        empty_ns=statistics.median(sample.empty_ns for sample in samples),
        deviation=first.deviation,
    )


@dataclass
class Arena:
    """The libraries that take part, and what they have measured so far."""

    libraries: dict[str, Library]
    sizes: Sizes
    folder: Path
    say: Callable[[str], None]
    rows: Rows = field(default_factory=Rows)
    absent: list[dict[str, str]] = field(default_factory=list)
    _processes: dict[str, Process] = field(default_factory=dict)
    _ended: set[str] = field(default_factory=set)  # until they load another tree

    def __enter__(self) -> Arena:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes.values():
            process.end()

    def ask(self, who: str, *words: object, seconds: float = ORDER_S) -> dict[str, Any]:
        if who in self._ended:
            raise Failure("it has ended before, and what it had loaded is lost")
        if who not in self._processes:
            self._processes[who] = Process(self.libraries[who])
        try:
            return self._processes[who].ask(*words, seconds=seconds)
        except Refusal:
            raise
        except Failure:
            # It has ended, or is still busy.
            self._processes.pop(who).kill()
            self._ended.add(who)
            raise

    def restart(self, who: str) -> None:
        """Give the next order to a new process, whose memory has never been used."""
        self._ended.discard(who)
        if who in self._processes:
            self._processes.pop(who).end()

    @contextmanager
    def process(self, program: str, *arguments: str, who: str = OURS) -> Iterator[Process]:
        """Another program of a library, in a ROS domain that hardly anyone else on this machine uses."""
        library = self.libraries[who]
        network = {"ROS_DOMAIN_ID": str(domain()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        command = [library.command[0], str(CONTESTANTS / program), *arguments]
        process = Process(replace(library, command=command, environment={**library.environment, **network}))
        try:
            yield process
        finally:
            process.end()

    def with_lookups(self) -> list[str]:
        """The libraries that answer single lookups."""
        return [who for who, library in self.libraries.items() if library.ways]

    def ways(self, keys: Iterable[str]) -> list[tuple[str, str]]:
        """(who, way) of every single lookup; ours first, because the others are compared with it."""
        return [(who, way) for who in keys for way in self.libraries[who].ways]

    @contextmanager
    def excused(self, who: str, what: str) -> Iterator[None]:
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
            with self.excused(who, tree.name):
                self.ask(who, "load", path, int(keep), seconds=LOAD_S)
                loaded.append(who)
        return loaded

    def prepare(
        self,
        section: str,
        labels: dict[str, Any],
        contenders: Iterable[tuple[str, str]],
        queries: Path,
        calls: int,
        per: int = 1,
        compared: bool = True,
    ) -> list[Entry]:
        """
        Hand each (who, way) the queries, compare the answers with ours, warm up; the entries of a race.

        :param per: transforms that one call looks up.
        :param compared: not so where nobody has an answer.
        """
        name = set_name(section, labels)
        entries = []
        truth: list[list[float] | None] = []
        for who, way in contenders:
            with self.excused(who, name):
                answers = self.ask(who, "prepare", way, name, queries, CHECKED if compared else 0)["answers"]
                if who == OURS:
                    truth = truth or answers
                warm_up = self.sizes.warm_up if per == 1 else 2
                if not self.ask(who, "time", way, name, warm_up, self.sizes.budget_s)["ns"]:
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
            answer = self.ask(who, *words) if process is None else process.ask(*words, seconds=ORDER_S)
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
                with self.excused(entries[index].who, section):
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
    """The ns of an answer, less the empty loop, for one transform; an insert tells how many it carries."""
    batch = per * answer.get("batch", 1)
    values = [(ns - answer["empty_ns"]) / batch for ns in answer["ns"]]
    return Sample(who, way, labels, values, "ns", answer["failed"], answer["empty_ns"], deviation)


def set_name(section: str, labels: dict[str, Any]) -> str:
    """What a set of queries is called, beside the way of looking up."""
    return "/".join(map(str, (section, *labels.values())))


def domain() -> int:
    return 60 + os.getpid() % 40


def largest_deviation(
    truth: Sequence[Sequence[float] | None], answers: Sequence[Sequence[float] | None]
) -> float | None:
    """Largest difference, in m or of a quaternion's component; None where nothing compares."""
    largest = None
    for ours, theirs in zip(truth, answers, strict=False):
        if ours is None or theirs is None:
            continue
        dot = sum(a * b for a, b in zip(ours[3:], theirs[3:], strict=False))
        sign = 1.0 if dot >= 0 else -1.0  # q and -q are one rotation
        signed = [*theirs[:3], *(sign * value for value in theirs[3:])]
        difference = max(abs(a - b) for a, b in zip(ours, signed, strict=False))
        largest = difference if largest is None else max(largest, difference)
    return largest
