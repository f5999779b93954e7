"""Format the results as tables."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from bench.processes import Library
from bench.race import OURS, Row, Rows
from bench.receiving import FLOOR, SECTION

WIDTH = 110
BUSY = 0.75  # load for each core, this run's own included
FIRST, COLUMN = 30, 15
# Section: title, and the way of ours that others are compared with.
SECTIONS = {
    "lookups": ("Single lookups, us per call", "buffer"),
    "online": (
        "Single lookups beside a process that publishes at 50 Hz, us; CPU seconds per second",
        "buffer",
    ),
    "vectors": ("Lookups at many times in one call, us per transform", "vector"),
    "growth": ("Growth: 4 dynamic hops at random times (vector: sorted), us per transform", "buffer"),
    "inserts": ("Inserts into full histories of 50 frames, us per transform", "set_transform"),
    "receiving": (
        "Receiving, us: CPU of the process per message, lookups, waits until their answer; messages lost",
        "listener",
    ),
    "nodes": ("Nodes that are spun, shared or not: CPU seconds per second of all of them", "listening"),
    "recordings": (
        "Recordings, us per transform loaded, per lookup, per pickle and back; recordings per second",
        "bag.load",
    ),
    "memory": ("Memory, bytes per dynamic sample", "resident"),
}
# Few things, each its own: a line for each row.
LISTED = (
    "online",
    "inserts",
    "receiving",
    "nodes",
    "recordings",
    "memory",
)
UNITS = {"x": "{:.2f}x", "B": "{:.1f}", "/s": "{:.2f}/s", "CPU": "{:.3f}"}


def introduction(
    machine: Mapping[str, Any],
    load: Sequence[float],
    libraries: Iterable[Library],
    missing: Mapping[str, str],
) -> str:
    versions = ", ".join(f"{name} {version}" for name, version in machine["versions"].items() if version)
    lines = [
        _rule("Benchmark of tf2-ros-cython"),
        f"{machine['cpu']}, {machine['cores']} cores, {machine['memory_gib']} GiB; {machine['system']}",
        versions,
        f"{machine['date']}; load average before {load[0]}, after {load[1]}",
        "Every library in its own process, in turn, round by round. Times are medians of all calls, below",
        "them the 5th and 95th percentile; the empty loop is subtracted. 2.0x: takes twice what ours takes.",
    ]
    if max(load) > BUSY * machine["cores"]:
        lines.append(
            "THE MACHINE WAS BUSY: the figures of threads and of what needs the caches are too high."
        )
    for library in libraries:
        python = library.about.get("python")
        python = f" on CPython {python}" if python else ""
        lines.append(f"  {library.label}{python}: {library.note or library.about.get('returns', '')}")
    lines += [f"  missing: {name}: {reason}" for name, reason in missing.items()]
    return "\n".join(lines)


def tables(rows: Rows, libraries: Mapping[str, Library]) -> str:
    """A table of each section that has rows."""
    parts = []
    for section, (title, main_way) in SECTIONS.items():
        own = [row for row in rows if row.section == section]
        if not own:
            continue
        if section in LISTED:
            lines = [_line(row, _main(own, main_way, row), libraries) for row in own]
        else:
            lines = _matrix(own, main_way, libraries)
        parts.append("\n".join([_rule(title), *(line.rstrip() for line in lines)]))
    return "\n\n".join(parts)


def _main(rows: Sequence[Row], main_way: str, compared: Row) -> Row | None:
    """The row of ours that one is compared with: of others, in their own way; where there is one, all are."""
    for way in (main_way,) if compared.who == OURS else (compared.way, main_way):
        own = [row for row in rows if (row.who, row.way) == (OURS, way)]
        main = own[0] if len(own) == 1 else next((row for row in own if row.labels == compared.labels), None)
        if main is not None:
            return main
    return None


def _matrix(rows: Sequence[Row], main_way: str, libraries: Mapping[str, Library]) -> list[str]:
    """A column for each library's way, a line for each set of labels."""
    columns: dict[tuple[str, str], list[Row]] = {}
    lines: dict[str, list[Row]] = {}
    for row in rows:
        columns.setdefault((row.who, row.way), []).append(row)
        lines.setdefault(_label(row.labels), []).append(row)
    heads = [_heads(libraries.get(who), who, way) for who, way in columns]
    empty = [f"{statistics.median(row.empty_ns for row in own):.0f}" for own in columns.values()]
    texts = [_cells("", own) for own in zip(*heads, strict=True)] + [_cells("(empty loop, ns)", empty)]
    for label, own in lines.items():
        main = next((row for row in own if (row.who, row.way) == (OURS, main_way)), None)
        at = {(row.who, row.way): row for row in own}
        cells = [_cell(at[column], main) if column in at else ("-", "") for column in columns]
        values, spreads = zip(*cells, strict=True)
        texts += [_cells(label, values), _cells("", spreads)]
    return texts


def _cells(first: str, texts: Iterable[str]) -> str:
    return f"{first:{FIRST}}" + "".join(f"{text:>{COLUMN}}" for text in texts)


def _heads(library: Library | None, who: str, way: str) -> tuple[str, str]:
    assert library is not None
    if who in (OURS, "ros2"):
        return "ours" if who == OURS else library.title, "Buffer" if way == "buffer" else way
    return library.title.removeprefix("Debian "), str(library.about.get("version", ""))


def _label(labels: Mapping[str, Any]) -> str:
    if "axis" in labels:
        return f"{labels['value']:,} {labels['axis']}" + (", all pairs" if labels["pairs"] == "many" else "")
    if "tree" not in labels:
        return ", ".join(
            f"{value:,} {key}" if isinstance(value, int) else f"{key.replace('_', ' ')} {value}"
            for key, value in labels.items()
        )
    if "threads" in labels:
        return f"{labels['tree']}, {labels['threads']} threads"
    place = "" if labels["tree"].startswith("static") else f", {labels['place']}"
    return f"{labels['tree']}{place}, {labels['hops']} hop{'s' * (labels['hops'] > 1)}"


def _number(row: Row, value: float) -> str:
    if row.unit != "ns":
        return UNITS.get(row.unit, "{:.0f}").format(value)
    value /= 1e3
    return f"{value:.0f}" if value >= 1000 else f"{value:.3g}"


def _cell(row: Row, main: Row | None) -> tuple[str, str]:
    ratio = f" {row.median / main.median:.1f}x" if main and row is not main and row.unit == main.unit else ""
    failed = "!" if row.failed else ""
    spread = f"{_number(row, row.p05)}-{_number(row, row.p95)}" if row.count > 1 else ""
    return failed + _number(row, row.median) + ratio, spread


def _line(row: Row, main: Row | None, libraries: Mapping[str, Library]) -> str:
    value, spread = _cell(row, main)
    return f"{libraries[row.who].label:26}{row.way:32}{_label(row.labels):42}{value:>12}  {spread}"


def remarks(rows: Rows, libraries: Mapping[str, Library], absent: Sequence[Mapping[str, str]]) -> str:
    """What did not answer, and whose answers are not ours."""
    lines = [_rule("Remarks")]
    floors = [row for row in rows.all(SECTION, OURS, FLOOR) if len(row.rounds) > 1]
    if floors:
        worst = max(floors, key=lambda row: max(row.rounds) / min(row.rounds))
        lowest, highest = (_number(worst, limit(worst.rounds)) for limit in (min, max))
        lines.append(
            "Noise: subscriptions that nobody takes from do the same in each round, and took from "
            f"{lowest} to {highest} us of CPU per message: {_label(worst.labels)}"
        )
    for who, library in libraries.items():
        failed = [row for row in rows if row.who == who and row.failed]
        if failed:
            worst = max(failed, key=lambda row: row.failed / (row.failed + row.count))
            calls = worst.failed + worst.count
            lines.append(
                f"{library.label} (!): no answer to {worst.failed:,} of {calls:,} calls: "
                f"{_label(worst.labels)}; only answers are timed (rows concerned: {len(failed)})"
            )
        compared = [row for row in rows if row.who == who and row.deviation is not None and row.who != OURS]
        if compared:
            worst = max(compared, key=lambda row: row.deviation or 0.0)
            lines.append(
                f"{library.label}: answers differ from ours by at most {worst.deviation:.1g} (m, or a "
                f"quaternion's component): {_label(worst.labels)}"
            )
    for entry in absent:
        name = libraries[entry["who"]].label if entry["who"] in libraries else entry["who"]
        lines.append(f"{name} takes no part in {entry['what']}: {entry['reason']}")
    return "\n".join(lines)


def _rule(title: str) -> str:
    return f"-- {title} {'-' * max(0, WIDTH - len(title) - 4)}"
