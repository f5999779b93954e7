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

from bench import guard, inserts, lookups, machine, nodes, peers, pictures, report, targets, types
from bench.processes import Failure
from bench.race import OURS, Run
from bench.sizes import FULL, QUICK

SECTIONS = {
    section.__name__: section
    for section in (
        lookups.lookups,
        lookups.growth,
        lookups.vectors,
        inserts.inserts,
        inserts.waiters,
        lookups.failing,
        inserts.memory,
        nodes.online,
        nodes.load,
        nodes.receive,
        types.types,
        guard.instructions,
    )
}
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
    parser.add_argument(
        "--only", nargs="+", choices=SECTIONS, help="of this project alone; nothing is written"
    )
    options = parser.parse_args(arguments)
    say = Progress()
    load_before = machine.load_average()
    ours = peers.ours()
    others, missing = ([], {}) if options.only else peers.all_peers(say)
    libraries = {library.key: library for library in (ours, *others)}
    with (
        tempfile.TemporaryDirectory() as folder,
        Run(libraries, QUICK if options.quick else FULL, Path(folder), say) as run,
    ):
        for who, library in list(libraries.items()):
            try:
                library.about = run.ask(who, "about")
            except Failure as failure:
                missing[library.title] = str(failure)
                del libraries[who]
        if OURS not in libraries:
            print(f"this project does not run here: {missing[ours.title]}", file=sys.stderr)
            return 1
        for name, section in SECTIONS.items():
            if name in (options.only or SECTIONS):
                with run.recording_failure(OURS, name):
                    section(run)
    result = {
        "machine": machine.describe(peers.ROOT),
        "load_average": {"before": load_before, "after": machine.load_average()},
        "quick": options.quick,
        "libraries": [
            {"key": library.key, "title": library.title, "note": library.note, **library.about}
            for library in libraries.values()
        ],
        "missing": missing,
        "absent": run.absent,
        "rows": run.rows.as_json(),
        "targets": [asdict(verdict) for verdict in targets.verdicts(run.rows)],
    }
    _print(result, run, bool(options.only))
    if not options.only:
        _write(result, run, QUICK_RESULTS if options.quick else RESULTS)
    return 0


def _print(result: dict[str, Any], run: Run, known_only: bool) -> None:
    busy = [result["load_average"][when][0] for when in ("before", "after")]
    verdicts = targets.verdicts(run.rows)
    if known_only:
        verdicts = [verdict for verdict in verdicts if verdict.verdict != targets.UNKNOWN]
    parts = [
        report.introduction(result["machine"], busy, run.libraries.values(), result["missing"]),
        report.tables(run.rows, run.libraries),
        report.remarks(run.rows, run.libraries, run.absent),
        report.verdict_table(verdicts),
    ]
    print(redacted("\n\n".join(parts)))


def _write(result: dict[str, Any], run: Run, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{machine.slug()}.json"
    path.write_text(redacted(json.dumps(result, indent=1)) + "\n")
    print(f"\nwrote {path.relative_to(peers.ROOT)}")
    try:
        for picture in pictures.draw(run.rows, run.libraries, folder, machine.slug()):
            print(f"wrote {picture.relative_to(peers.ROOT)}")
    except ImportError:
        print("no pictures: matplotlib is missing (pip install '.[bench]')")


def redacted(text: str) -> str:
    """Without the paths of this machine and the addresses of its registries, which some errors name."""
    text = re.sub(r"\b(?:https?|file)://[^\s\"']+", "(an address)", text)
    for path in (peers.ROOT, Path(sys.prefix), Path.home()):
        if path != Path(path.anchor):
            text = text.replace(str(path), "...")
    return text


if __name__ == "__main__":
    sys.exit(main())
