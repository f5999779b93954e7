"""Owns measuring side by side: every library does the same, in turn, round by round."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.processes import Failure, Library, Process, Refusal
from bench.rows import Rows, row_of
from bench.sizes import Sizes
from bench.trees import Tree

LOAD_S = 40.0  # who needs longer to take a tree in, does not take part
OURS = "ours"
CHECKED = 5  # answers that are compared with ours


@dataclass
class Entry:
    """One kind of call in a race: who makes it, by which order, and what it is called in the rows."""

    who: str
    way: str
    labels: dict[str, Any]
    order: Sequence[object]  # without the budget, which comes last
    per: int = 1  # transforms that one call looks up; an insert's answer tells it itself
    deviation: float | None = None


class Arena:
    """The libraries that take part, and what they have done so far."""

    def __init__(
        self, libraries: Iterable[Library], sizes: Sizes, folder: Path, say: Callable[[str], None]
    ) -> None:
        self.libraries = {library.key: library for library in libraries}
        self.sizes = sizes
        self.folder = folder
        self.say = say
        self.rows = Rows()
        self.absent: list[dict[str, str]] = []
        self._processes: dict[str, Process] = {}
        self._lost: set[str] = set()  # ended, and with them what they had taken in

    def __enter__(self) -> Arena:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes.values():
            process.end()

    def ask(self, who: str, *words: object, **options: Any) -> dict[str, Any]:
        if who not in self._processes:
            self._processes[who] = Process(self.libraries[who])
        try:
            return self._processes[who].ask(*words, **options)
        except Refusal:
            raise
        except Failure:
            # It has died, or is still busy: the next order goes to a new one.
            self._processes.pop(who).kill()
            self._lost.add(who)
            raise

    def restart(self, who: str) -> None:
        """Give the next order to a new process, with memory that nothing has been in."""
        self._lost.discard(who)
        if who in self._processes:
            self._processes.pop(who).end()

    def load(self, tree: Tree, keys: Iterable[str], keep: bool = False) -> list[str]:
        """
        Have libraries take a tree in; those that did.

        :param keep: trees taken in before stay, and their sets of queries.
        """
        path = tree.write(self.folder)
        taken = []
        for who in filter(self.libraries.__contains__, keys):
            self._lost.discard(who)
            if self.attempt(who, tree.name, "load", path, int(keep), seconds=LOAD_S):
                taken.append(who)
        return taken

    def attempt(self, who: str, what: str, *words: object, **options: Any) -> dict[str, Any] | None:
        """As :meth:`ask`; where it fails, None, and the reason is kept. Who is lost is asked for no more."""
        if who in self._lost:
            return None
        try:
            return self.ask(who, *words, **options) or {"done": True}
        except Failure as failure:
            self.absent.append({"who": who, "what": what, "reason": str(failure)})
            return None

    def aim(
        self,
        section: str,
        labels: dict[str, Any],
        contenders: Iterable[tuple[str, str]],
        queries: Path,
        calls: int,
        per: int = 1,
    ) -> list[Entry]:
        """Hand each (who, way) the queries, compare the answers with ours, warm up; the entries of a race."""
        name = "/".join(map(str, (section, *labels.values())))
        entries = []
        truth: list[list[float] | None] = []
        for who, way in contenders:
            answer = self.attempt(who, name, "aim", way, name, queries, CHECKED)
            if answer is None:
                continue
            if who == OURS:
                truth = truth or answer["answers"]
            deviation = largest_deviation(truth, answer["answers"])
            warm_up = self.sizes.warm_up if per == 1 else 2
            warm = self.attempt(who, name, "time", way, name, warm_up, self.sizes.budget_s, seconds=60)
            if warm is None:
                continue
            if not warm["ns"]:
                self.absent.append(
                    {"who": who, "what": name, "reason": "it has no answer to any of the queries"}
                )
                continue
            entries.append(Entry(who, way, labels, ("time", way, name, calls), per, deviation))
        return entries

    def race(self, section: str, entries: Sequence[Entry]) -> None:
        """Run the entries in turn, each round beginning with another; add their rows."""
        values: list[list[list[float]]] = [[] for _ in entries]
        failed: list[int] = [0] * len(entries)
        empty: list[list[float]] = [[] for _ in entries]
        for turn in range(self.sizes.rounds):
            for k in range(len(entries)):
                index = (turn + k) % len(entries)
                entry = entries[index]
                answer = self.attempt(entry.who, section, *entry.order, self.sizes.budget_s, seconds=60)
                if answer is None:
                    continue
                batch = entry.per * answer.get("batch", 1)
                values[index].append([(ns - answer["empty_ns"]) / batch for ns in answer["ns"]])
                failed[index] += answer["failed"]
                empty[index].append(answer["empty_ns"])
        for i, entry in enumerate(entries):
            if any(values[i]):
                row = row_of(section, entry.who, entry.way, entry.labels, values[i])
                row.failed, row.deviation = failed[i], entry.deviation
                row.empty_ns = statistics.median(empty[i])
                self.rows.append(row)

    def with_lookups(self) -> list[str]:
        """The libraries that answer single lookups."""
        return [key for key, library in self.libraries.items() if library.ways]

    def ways(self, keys: Iterable[str]) -> list[tuple[str, str]]:
        """(who, way) of every single lookup; ours first, for the others are compared with it."""
        return [(who, way) for who in keys for way in self.libraries[who].ways]


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
