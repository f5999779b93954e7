# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The results of a run, and the page of Markdown tables that shows them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bench.libraries import OURS, Library

TITLES = {
    "lookups": "One lookup, µs",
    "calls": "Calls as programs make them, over 4 hops, µs",
    "vectors": "Lookups at many times in one call, µs per transform",
    "inserts": "Inserts into full histories of 50 frames, µs per transform",
    "clouds": "Clouds of 100,000 points, µs",
    "memory": "Memory, bytes per sample",
    "receiving:cpu": "CPU of a process per message it receives, µs",
    "receiving:waits": "How soon a waiting lookup returns, µs",
    "tf2_rs:offline": "Lookups as in the evaluation of tf2_rs, offline, µs",
    "tf2_rs:online": "The same, online: beside a process that publishes 300 frames, half of them at 50 Hz, "
    "µs; CPU seconds per second",
    "nodes": "CPU seconds per second of nodes that are spun, all together",
    "frozen": "Frozen files: writing, opening and lookups, µs; bytes per sample",
}
METHOD = (
    "Each library runs in processes of its own, which take turns, round by round. The values are medians of "
    "all rounds, with the 5th and the 95th percentile; the empty loop is subtracted."
)
UNITS = {
    "B": "{:.1f} B",
    "/s": "{:.2f}/s",
    "CPU": "{:.3f}",
}


@dataclass
class Row:
    """
    What one library's calls of one kind took, in ns or in another unit.

    `labels` say what was measured: tree, hops, place in the history, ...
    """

    section: str
    who: str
    way: str
    labels: dict[str, Any]
    unit: str
    values: list[float] = field(default_factory=list)
    failed: int = 0

    @property
    def key(self) -> tuple[Any, ...]:
        return self.section, self.who, self.way, *self.labels.items()

    def percentile(self, percent: float) -> float:
        return float(np.percentile(self.values, percent))


class Rows(dict[tuple[Any, ...], Row]):
    """All rows of a run."""

    def add(self, section: str, who: str, found: list[dict[str, Any]]) -> None:
        """Add what a process has measured in one round."""
        for one in found:
            row = Row(section, who, one["way"], one["labels"], one["unit"])
            row = self.setdefault(row.key, row)
            row.values += one["values"]
            row.failed += one["failed"]

    def of(self, section: str) -> list[Row]:
        return [row for row in self.values() if row.section == section]


def head(libraries: Mapping[str, Library], machine: Iterable[str], missing: Mapping[str, str]) -> str:
    """
    The beginning of the report, which all its sections share.

    :param machine: lines about the machine.
    :param missing: libraries that cannot be had, and why.
    """
    lines = ["# Benchmark", "", *(f"- {line}" for line in machine)]
    lines += [f"- {library.title}: {library.note}" for library in libraries.values()]
    lines += [f"- missing: {title}: {reason}" for title, reason in missing.items()]
    lines += ["", METHOD]
    return "\n".join(lines) + "\n"


def section(name: str, rows: Sequence[Row], libraries: Mapping[str, Library], remarks: Iterable[str]) -> str:
    """
    The text of a section.

    :param remarks: how it was measured, and what failed.
    """
    lines = [f"## {TITLES[name]}", "", *(f"- {one}" for one in (*remarks, *_failures(rows, libraries)))]
    return "\n".join([*lines, "", *_table(rows, libraries)]) + "\n"


def head_of(text: str) -> str:
    """The head of a report."""
    return text.partition("\n## ")[0]


def with_section(text: str, section: str) -> str:
    """A report with this section, which replaces the one of the same title."""
    first, *others = re.split(r"\n(?=## )", text)
    found = {one.partition("\n")[0]: one for one in (*others, section)}
    order = [f"## {title}" for title in TITLES.values()]
    return "\n".join([first, *sorted(found.values(), key=lambda one: order.index(one.partition("\n")[0]))])


def _table(rows: Sequence[Row], libraries: Mapping[str, Library]) -> Iterable[str]:
    """A column for each library's way, a line for each set of labels."""
    columns = list(dict.fromkeys((row.who, row.way) for row in rows))
    heads = ["ours" if who == OURS else libraries[who].title for who, _ in columns]
    yield _line("", (f"{head}: {way}" for head, (_, way) in zip(heads, columns, strict=True)))
    yield _line("---", ["---"] * len(columns))
    for label in dict.fromkeys(_label(row.labels) for row in rows):
        at = {(row.who, row.way): row for row in rows if _label(row.labels) == label}
        yield _line(label, (_cell(at[column]) if column in at else "" for column in columns))


def _line(first: str, cells: Iterable[str]) -> str:
    return f"| {first} | {' | '.join(cells)} |"


def _label(labels: Mapping[str, Any]) -> str:
    return ", ".join(
        value if isinstance(value, str) else f"{value:,} {key.removesuffix('s') if value == 1 else key}"
        for key, value in labels.items()
    )


def _cell(row: Row) -> str:
    value = _number(row, row.percentile(50))
    if row.unit == "ns" and len(row.values) > 1:
        value += f" ({_number(row, row.percentile(5))}–{_number(row, row.percentile(95))})"
    return value + " !" * bool(row.failed)


def _number(row: Row, value: float) -> str:
    if row.unit != "ns":
        return UNITS[row.unit].format(value)
    return f"{value / 1e3:.0f}" if value >= 999_500 else f"{value / 1e3:.3g}"


def _failures(rows: Sequence[Row], libraries: Mapping[str, Library]) -> Iterable[str]:
    for who, library in libraries.items():
        if failed := sum(row.failed for row in rows if row.who == who):
            yield f"!: {library.title} had no answer to {failed:,} calls, which are not timed"
