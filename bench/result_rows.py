"""The results of a run: rows of one kind of measurement, of all rounds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np


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
    answers: list[list[float] | None] = field(default_factory=list)

    @property
    def key(self) -> tuple[Any, ...]:
        return self.section, self.who, self.way, *self.labels.items()

    def percentile(self, percent: float) -> float:
        return float(np.percentile(self.values, percent))

    def deviation(self, truth: Row) -> float:
        """Largest difference of its answers from others, in m or of a quaternion's component."""
        largest = 0.0
        for ours, theirs in zip(truth.answers, self.answers, strict=False):
            if ours is not None and theirs is not None:
                a, b = np.array(ours), np.array(theirs)
                b[3:] *= np.copysign(1.0, a[3:] @ b[3:])  # q and -q are one rotation
                largest = max(largest, float(np.abs(a - b).max()))
        return largest


class Rows(dict[tuple[Any, ...], Row]):
    """All rows of a run."""

    def add(self, section: str, who: str, found: list[dict[str, Any]]) -> None:
        """Add what a process has measured in one round."""
        for one in found:
            row = Row(section, who, one["way"], one["labels"], one["unit"], answers=one["answers"])
            row = self.setdefault(row.key, row)
            row.values += one["values"]
            row.failed += one["failed"]

    def of(self, section: str) -> list[Row]:
        return [row for row in self.values() if row.section == section]
