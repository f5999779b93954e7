"""
The benchmark's command line: `python -m bench [--quick]` measures, prints, writes JSON and pictures.

`python -m bench --only waiters receiving:cpu` measures a section and a part of one, of this project and of a
sourced ROS 2, and only prints.
"""

from __future__ import annotations

import argparse
import datetime
import importlib.metadata
import json
import os
import platform
import re
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench import (
    inserts,
    lookups,
    nodes,
    peers,
    pictures,
    receiving,
    recordings,
    report,
)
from bench.processes import Failure, run_command
from bench.race import OURS, Run
from bench.sizes import FULL, QUICK

SECTIONS = (
    {
        section.__name__: section
        for section in (
            lookups.lookups,
            lookups.growth,
            lookups.vectors,
            inserts.inserts,
            inserts.memory,
            nodes.online,
            recordings.recordings,
        )
    }
    | {"nodes": nodes.many}
    | {f"{receiving.SECTION}:{part.__name__}": part for part in receiving.PARTS}
)
RESULTS = Path(__file__).resolve().parent / "results"
PACKAGES = ("tf2-ros-cython", "numpy", "ros-jazzy-rclpy", "matplotlib")
QUICK_RESULTS = peers.FETCHED / "results"


class Progress:
    """One line a step, with the time since the start, beside the tables."""

    def __init__(self) -> None:
        self._start = time.monotonic()

    def __call__(self, text: str) -> None:
        print(f"{time.monotonic() - self._start:6.1f} s  {text}", file=sys.stderr, flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m bench", description="Compare this project with other libraries."
    )
    parser.add_argument("--quick", action="store_true", help="fewer rounds and sizes: within two minutes")
    parser.add_argument(
        "--only",
        nargs="+",
        choices=[receiving.SECTION, *SECTIONS],
        metavar="SECTION",
        help="measure only these, for this project and a sourced ROS 2, and write no files: %(choices)s",
    )
    options = parser.parse_args(arguments)
    say = Progress()
    load_before = _load_average()
    ours = peers.ours()
    others, missing = peers.all_peers(say, only_ros2=bool(options.only))
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
            if not options.only or {name, name.partition(":")[0]} & set(options.only):
                with run.recording_failure(OURS, name):
                    section(run)
    result = {
        "machine": _machine(),
        "load_average": {"before": load_before, "after": _load_average()},
        "quick": options.quick,
        "libraries": [
            {"key": library.key, "title": library.title, "note": library.note, **library.about}
            for library in libraries.values()
        ],
        "missing": missing,
        "absent": run.absent,
        "rows": run.rows.as_json(),
    }
    _print(result, run)
    if not options.only:
        _write(result, run, QUICK_RESULTS if options.quick else RESULTS)
    return 0


def _print(result: dict[str, Any], run: Run) -> None:
    busy = [result["load_average"][when][0] for when in ("before", "after")]
    parts = [
        report.introduction(result["machine"], busy, run.libraries.values(), result["missing"]),
        report.tables(run.rows, run.libraries),
        report.remarks(run.rows, run.libraries, run.absent),
    ]
    print(redacted("\n\n".join(parts)))


def _write(result: dict[str, Any], run: Run, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{_slug()}.json"
    path.write_text(redacted(json.dumps(result, indent=1)) + "\n")
    print(f"\nwrote {path.relative_to(peers.ROOT)}")
    try:
        for picture in pictures.draw(run.rows, run.libraries, folder, _slug()):
            print(f"wrote {picture.relative_to(peers.ROOT)}")
    except ImportError:
        print("no pictures: matplotlib is missing (pip install '.[bench]')")


def _cpu() -> str:
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.machine()


def _slug() -> str:
    return re.sub(r"[^a-z0-9]+", "-", f"{_cpu()} {os.cpu_count()} cores".lower()).strip("-")


def _load_average() -> list[float]:
    return [round(value, 2) for value in os.getloadavg()]


def _machine() -> dict[str, Any]:
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return {
        "cpu": _cpu(),
        "cores": os.cpu_count(),
        "memory_gib": round(memory / 2**30),
        "system": platform.freedesktop_os_release().get("PRETTY_NAME", platform.system()),
        "kernel": platform.release(),
        "date": datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
        "versions": {"python": platform.python_version(), "project": _revision()}
        | {package: _version(package) for package in PACKAGES},
    }


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _revision() -> str:
    try:
        return run_command(
            "git", "-C", str(peers.ROOT), "describe", "--always", "--dirty", seconds=20
        ).strip()
    except Failure:
        return "unknown"


def redacted(text: str) -> str:
    """Without the paths of this machine and the addresses of its registries, which some errors name."""
    text = re.sub(r"\b(?:https?|file)://[^\s\"']+", "(an address)", text)
    for path in (peers.ROOT, Path(sys.prefix), Path.home()):
        if path != Path(path.anchor):
            text = text.replace(str(path), "...")
    return text


if __name__ == "__main__":
    sys.exit(main())
