"""
The benchmark's command line: `python -m bench [--quick]` measures, prints, writes JSON and pictures.

`python -m bench --only waiters load` measures these sections of this project alone, and only prints.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from bench import (
    failing,
    growth,
    inserts,
    instructions,
    load,
    lookups,
    machine,
    memory,
    online,
    peers,
    pictures,
    report,
    targets,
    types,
    vectors,
    waiters,
)
from bench.arena import Arena
from bench.processes import Failure
from bench.rows import Row
from bench.sizes import FULL, QUICK

SECTIONS = (lookups, growth, vectors, inserts, waiters, failing, memory, online, load, instructions)
RESULTS = Path(__file__).resolve().parent / "results"
QUICK_RESULTS = peers.FETCHED / "results"


class Progress:
    """One line a step, with the time since the start, beside the tables."""

    def __init__(self) -> None:
        self._start = time.monotonic()

    def __call__(self, text: str) -> None:
        print(f"{time.monotonic() - self._start:6.1f} s  {text}", file=sys.stderr, flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m bench", description="Measure this project beside its peers."
    )
    parser.add_argument("--quick", action="store_true", help="fewer rounds and sizes: within two minutes")
    names = [section.SECTION for section in SECTIONS]
    parser.add_argument("--only", nargs="+", choices=names, help="of this project alone; nothing is written")
    options = parser.parse_args(arguments)
    quick, wanted = options.quick, options.only or names
    say = Progress()
    load_before = machine.load_average()
    ours = peers.ours()
    others, missing = ([], {}) if options.only else peers.all_peers(say)
    with (
        tempfile.TemporaryDirectory() as folder,
        Arena([ours, *others], QUICK if quick else FULL, Path(folder), say) as arena,
    ):
        try:
            ours.about = arena.ask(ours.key, "about")
        except Failure as failure:
            print(f"this project does not run here: {failure}", file=sys.stderr)
            return 1
        for section in SECTIONS:
            if section.SECTION not in wanted:
                continue
            try:
                section.run(arena)
            except Failure as failure:
                arena.absent.append({"who": ours.key, "what": section.SECTION, "reason": str(failure)})
    types_rows = []
    if not options.only:
        say("functions of the types")
        types_rows = types.run(quick)
    arena.rows.extend(Row(**row) for row in types_rows)
    result = {
        "machine": machine.describe(peers.ROOT),
        "load_average": {"before": load_before, "after": machine.load_average()},
        "quick": quick,
        "libraries": [
            {"key": library.key, "title": library.title, "note": library.note, **library.about}
            for library in arena.libraries.values()
        ],
        "missing": missing,
        "absent": arena.absent,
        "rows": arena.rows.as_json(),
        "targets": [asdict(verdict) for verdict in targets.verdicts(arena.rows)],
    }
    _print(result, arena, types_rows)
    if not options.only:
        _write(result, arena, QUICK_RESULTS if quick else RESULTS)
    return 0


def _print(result: dict[str, Any], arena: Arena, types_rows: list[dict[str, Any]]) -> None:
    busy = [result["load_average"][when][0] for when in ("before", "after")]
    parts = [
        report.introduction(result["machine"], busy, arena.libraries.values(), result["missing"]),
        report.tables(arena.rows, arena.libraries),
    ]
    if any(row.section == waiters.SECTION for row in arena.rows):
        parts.append(report.part(waiters.TITLE, waiters.table(arena.rows)))
    verdicts = targets.verdicts(arena.rows)
    if types_rows:
        parts.append(report.part("Functions of the types", types.table(types_rows)))
    else:
        verdicts = [verdict for verdict in verdicts if verdict.verdict != targets.UNKNOWN]
    parts += [report.remarks(arena.rows, arena.libraries, arena.absent), report.verdict_table(verdicts)]
    print(redacted("\n\n".join(parts)))


def _write(result: dict[str, Any], arena: Arena, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{machine.slug()}.json"
    path.write_text(redacted(json.dumps(result, indent=1)) + "\n")
    print(f"\nwrote {path.relative_to(peers.ROOT)}")
    try:
        for picture in pictures.draw(arena.rows, arena.libraries, folder, machine.slug()):
            print(f"wrote {picture.relative_to(peers.ROOT)}")
    except ImportError:
        print("no pictures: matplotlib is missing (pip install '.[bench]')")


def redacted(text: str) -> str:
    """Without the places of this machine and its registries, which some reasons for a failure name."""
    text = re.sub(r"\b(?:https?|file)://[^\s\"']+", "(an address)", text)
    for place in (peers.ROOT, Path(sys.prefix), Path.home()):
        if place != Path(place.anchor):
            text = text.replace(str(place), "...")
    return text


if __name__ == "__main__":
    sys.exit(main())
