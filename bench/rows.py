"""Owns what was measured: one row for each thing that one library did."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any


def percentile(ordered: Sequence[float], share: float) -> float:
    """By linear interpolation between the two nearest ranks."""
    place = share * (len(ordered) - 1)
    low = int(place)
    high = min(low + 1, len(ordered) - 1)
    return ordered[low] + (place - low) * (ordered[high] - ordered[low])


@dataclass
class Row:
    """
    Times of one kind of call of one library, in ns for one transform; or another quantity, in `unit`.

    `labels` say what was asked: tree, hops, place in the history, ... The percentiles are of all calls of all
    rounds; `rounds` are each round's median.
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
    empty_ns: float = 0.0  # the loop without the call; subtracted already
    deviation: float | None = (
        None  # largest difference between its answers and ours: m, or quaternion components
    )


def row_of(
    section: str, who: str, way: str, labels: dict[str, Any], rounds: Sequence[Sequence[float]], **more: Any
) -> Row:
    """A row of all values of all rounds."""
    pooled = sorted(value for values in rounds for value in values)
    return Row(
        section,
        who,
        way,
        labels,
        median=percentile(pooled, 0.5),
        p05=percentile(pooled, 0.05),
        p25=percentile(pooled, 0.25),
        p75=percentile(pooled, 0.75),
        p95=percentile(pooled, 0.95),
        rounds=[statistics.median(values) for values in rounds if values],
        count=len(pooled),
        **more,
    )


def ratio_by_rounds(above: Row | None, below: Row | None) -> float | None:
    """
    The median of the rounds' ratios; None where one is missing.

    For two rows that were measured in turn: whatever else the machine does, weighs on both.
    """
    if above is None or below is None:
        return None
    return statistics.median(a / b for a, b in zip(above.rounds, below.rounds, strict=True))


class Rows(list[Row]):
    """All rows of a run."""

    def find(self, section: str, who: str, way: str, **labels: Any) -> Row | None:
        """The row with these labels among its own; None if it was not measured."""
        for row in self:
            if (row.section, row.who, row.way) == (section, who, way) and all(
                row.labels.get(key) == value for key, value in labels.items()
            ):
                return row
        return None

    def as_json(self) -> list[dict[str, Any]]:
        return [asdict(row) for row in self]
