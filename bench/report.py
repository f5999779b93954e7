"""Owns the tables and the verdicts as text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from bench.arena import OURS
from bench.jazzy import cpp_factor, python_factor
from bench.processes import Library
from bench.rows import Row, Rows
from bench.targets import Verdict

WIDTH = 110
BUSY = 0.75  # load for each core, this run's own included
FIRST, COLUMN = 30, 15
MAIN_WAY = {"lookups": "buffer", "online": "buffer", "growth": "buffer", "vectors": "vector",
            "inserts": "set_transform", "memory": "resident"}  # fmt: skip
ONE_BY_ONE = (
    "inserts",
    "failing",
    "load",
    "memory",
    "instructions",
)  # few things, each its own: a line for each
WAY_TITLES = {"buffer": "Buffer"}
SECTION_TITLES = {
    "lookups": "Single lookups, us per call",
    "online": "Single lookups while another process publishes at 100 Hz over DDS, us per call",
    "vectors": "Lookups at many times in one call, us per transform",
    "growth": "Growth: 4 dynamic hops at random times (vector: sorted), us per transform",
    "inserts": "Inserts into full histories of 50 frames, us per transform",
    "failing": "Lookups that fail, us per call",
    "load": "Readers and writers at once, us (readers: in vector lookups; this: the buffer that is timed)",
    "memory": "Memory, bytes per dynamic sample",
    "instructions": "Growth in instructions (callgrind), 4 dynamic hops, per transform",
}


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
        lines.append("THE MACHINE WAS BUSY: two threads, and whatever needs the caches, come off too badly.")
    for library in libraries:
        python = library.about.get("python")
        python = f" on CPython {python}" if python else ""
        lines.append(f"  {library.label}{python}: {library.note or library.about.get('returns', '')}")
    lines += [f"  missing: {name}: {reason}" for name, reason in missing.items()]
    return "\n".join(lines)


def tables(rows: Rows, libraries: Mapping[str, Library]) -> str:
    return "\n\n".join(
        _table(section, title, [row for row in rows if row.section == section], libraries)
        for section, title in SECTION_TITLES.items()
        if any(row.section == section for row in rows)
    )


def _table(section: str, title: str, rows: Sequence[Row], libraries: Mapping[str, Library]) -> str:
    columns = list(dict.fromkeys((row.who, row.way) for row in rows))
    lines = [_rule(title)]
    if section in ONE_BY_ONE:
        main = next((row for row in rows if (row.who, row.way) == (OURS, MAIN_WAY.get(section))), None)
        return "\n".join([*lines, *(_line(row, main, libraries) for row in rows)])
    heads = [_heads(libraries[who], way) for who, way in columns]
    for k in range(2):
        lines.append(" " * FIRST + "".join(f"{head[k]:>{COLUMN}}" for head in heads))
    empty = {column: [row.empty_ns for row in rows if (row.who, row.way) == column] for column in columns}
    lines.append(
        f"{'(empty loop, ns)':{FIRST}}"
        + "".join(f"{sorted(empty[column])[len(empty[column]) // 2]:>{COLUMN}.0f}" for column in columns)
    )
    for labels in dict.fromkeys(tuple(row.labels.items()) for row in rows):
        at = {(row.who, row.way): row for row in rows if tuple(row.labels.items()) == labels}
        main = at.get((OURS, MAIN_WAY[section]))
        cells = [_cell(at.get(column), main) for column in columns]
        lines.append(f"{_label(dict(labels)):{FIRST}}" + "".join(f"{cell[0]:>{COLUMN}}" for cell in cells))
        lines.append(" " * FIRST + "".join(f"{cell[1]:>{COLUMN}}" for cell in cells))
    return "\n".join(line.rstrip() for line in lines)


def _heads(library: Library, way: str) -> tuple[str, str]:
    if library.key in (OURS, "ros2"):
        return "ours" if library.key == OURS else library.title, WAY_TITLES.get(way, way)
    return library.title.removeprefix("Debian "), str(library.about.get("version", ""))


def _label(labels: Mapping[str, Any]) -> str:
    if "axis" in labels:
        return f"{labels['value']:,} {labels['axis']}" + (", all pairs" if labels["pairs"] == "many" else "")
    if "threads" in labels:
        return f"{labels['tree']}, {labels['threads']} threads"
    place = "" if labels["tree"].startswith("static") else f", {labels['place']}"
    return f"{labels['tree']}{place}, {labels['hops']} hop{'s' * (labels['hops'] > 1)}"


def _number(row: Row, value: float) -> str:
    if row.unit != "ns":
        return {"x": f"{value:.2f}x", "B": f"{value:.1f}"}.get(row.unit, f"{value:.0f}")
    value /= 1e3
    return f"{value:.0f}" if value >= 1000 else f"{value:.3g}"


def _cell(row: Row | None, main: Row | None) -> tuple[str, str]:
    if row is None:
        return "-", ""
    ratio = f" {row.median / main.median:.1f}x" if main and row is not main and row.unit == main.unit else ""
    failed = "!" if row.failed else ""
    spread = f"{_number(row, row.p05)}-{_number(row, row.p95)}" if row.count > 1 else ""
    return failed + _number(row, row.median) + ratio, spread


def _line(row: Row, main: Row | None, libraries: Mapping[str, Library]) -> str:
    labels = ", ".join(
        f"{value:,} {key}" if isinstance(value, int) else f"{key.replace('_', ' ')} {value}"
        for key, value in row.labels.items()
    )
    value, spread = _cell(row, main)
    return f"{libraries[row.who].label:26}{row.way:32}{labels:42}{value:>12}  {spread}".rstrip()


def remarks(rows: Rows, libraries: Mapping[str, Library], absent: Sequence[Mapping[str, str]]) -> str:
    """What did not answer, and whose answers are not ours."""
    lines = [_rule("Remarks")]
    factor, python = cpp_factor(rows), python_factor(rows)
    if factor and python:
        lines.append(
            f"Debian's C++ takes {factor:.2f}, its Python {python:.2f} times what they took where tf2 of "
            "ROS 2 Jazzy was measured beside them."
        )
    for who, library in libraries.items():
        failed = [row for row in rows if row.who == who and row.failed]
        if failed:
            worst = max(failed, key=lambda row: row.failed / (row.failed + row.count))
            asked = worst.failed + worst.count
            lines.append(
                f"{library.label} (!): no answer to {worst.failed:,} of {asked:,} calls: "
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


def verdict_table(verdicts: Sequence[Verdict]) -> str:
    lines = [_rule("Targets")]
    for verdict in verdicts:
        lines.append(f"{verdict.target}  {verdict.verdict:13}{verdict.what}")
        lines.append(f"{'':16}{verdict.measured}; wanted {verdict.wanted}")
    return "\n".join(lines)


def part(title: str, text: str) -> str:
    """What a section says of itself, among the others."""
    return f"{_rule(title)}\n{text}"


def _rule(title: str) -> str:
    return f"-- {title} {'-' * max(0, WIDTH - len(title) - 4)}"
