# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
The benchmark's command line: `python -m bench [--quick]` measures, prints, and writes a report.

`python -m bench --only inserts receiving:cpu` measures sections, and only prints.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from bench import report
from bench.libraries import FETCHED, OURS, PROGRAMS, ROOT, Library, last_line, libraries
from bench.run_sizes import FULL, QUICK
from release.child_environment import environment_of_children
from reliability.own_ros_domain import claim_domain

RESULTS = Path(__file__).resolve().parent / "results"
ROUND_S = 900.0  # the longest that a process may take
EVERY = (OURS, "ros2", "tf2_cpp", "tf_tree")
ROS2 = (OURS, "ros2")


class Section(NamedTuple):
    """A function of `programs`, who is measured with it, and with which further arguments."""

    function: str
    libraries: Sequence[str]
    variants: Sequence[str] = ("",)
    ours_only: Sequence[str] = ()  # further variants
    rounds: int = 7  # at most


SECTIONS = {
    "lookups": Section("lookups.lookups", EVERY),
    "vectors": Section("lookups.vectors", (OURS, "tf_tree")),
    "inserts": Section("inserts_and_memory.inserts", EVERY),
    "clouds": Section("clouds.clouds", (OURS,)),
    "memory": Section("inserts_and_memory.memory", EVERY, rounds=1),
    "receiving:cpu": Section(
        "receiving.cpu",
        ROS2,
        ["listener", "spin_once", "executor.spin_once", "spin_once+lookup"],
        ["overridden"],
    ),
    "receiving:waits": Section("receiving.waits", ROS2, ["blocked", "own insert"]),
    "online": Section("lookups_while_receiving.online", ROS2, rounds=5),
    "nodes": Section("many_nodes.many", (OURS,), ["apart", "together"], rounds=3),
    "frozen": Section("frozen_files.frozen", (OURS,), rounds=3),
}


class Run:
    """Measure sections, round by round; `rows` are the results, `remarks` what failed."""

    def __init__(self, found: dict[str, Library], sizes: dict[str, Any], folder: Path) -> None:
        self.libraries, self.sizes = found, sizes | {"folder": str(folder)}
        self.rows = report.Rows()
        self.remarks: list[str] = []
        self._out = folder / "rows.json"
        self._began = time.monotonic()

    def say(self, text: str) -> None:
        print(f"{time.monotonic() - self._began:6.1f} s  {text}", file=sys.stderr, flush=True)

    def measure(self, name: str, section: Section) -> None:
        takers = [who for who in section.libraries if who in self.libraries]
        entries = [(who, variant) for variant in section.variants for who in takers]
        entries += [(OURS, variant) for variant in section.ours_only]
        for turn in range(min(section.rounds, self.sizes["rounds"])):
            # Each round begins with another one, and whoever fails takes part no longer.
            for entry in entries[turn % len(entries) :] + entries[: turn % len(entries)]:
                self.say(f"{name}, round {turn + 1}: {' '.join(entry)}")
                if (problem := self._run(name, section.function, *entry)) is not None:
                    self.remarks.append(f"{self.libraries[entry[0]].title} left {name}: {problem}")
                    entries.remove(entry)

    def _run(self, name: str, function: str, who: str, variant: str) -> str | None:
        """Measure one of them for one round; what went wrong, if something did."""
        library = self.libraries[who]
        command = [library.python, str(PROGRAMS / "measure_section.py"), who, function]
        command += [json.dumps(self.sizes), str(self._out), *([variant] if variant else [])]
        environment = _environment() | library.environment
        try:
            subprocess.run(
                command, env=environment, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                text=True, timeout=ROUND_S,
            )  # fmt: skip
        except (OSError, subprocess.TimeoutExpired) as error:
            return str(error)
        except subprocess.CalledProcessError as error:
            return last_line(error.stderr)
        self.rows.add(name, who, json.loads(self._out.read_text()))
        return None


@cache
def _domain() -> int:
    return claim_domain()


def _environment() -> dict[str, str]:
    environment = environment_of_children(
        ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST",
        ROS_DOMAIN_ID=str(_domain()),
        # As in the published figures of upstream; and it makes no library slower.
        PYTHONOPTIMIZE="1",
        # NumPy's helper threads spin for a while, beside whatever is measured.
        OPENBLAS_NUM_THREADS="1",
    )
    environment.pop("ROS_LOCALHOST_ONLY", None)  # it would override the range of discovery
    return environment


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m bench", description="Compare this project with other libraries."
    )
    parser.add_argument("--quick", action="store_true", help="fewer rounds and sizes: a few minutes")
    groups = dict.fromkeys(name.partition(":")[0] for name in SECTIONS)
    parser.add_argument(
        "--only",
        nargs="+",
        choices=dict.fromkeys([*groups, *SECTIONS]),
        metavar="SECTION",
        help="measure only these, and write no files: %(choices)s",
    )
    options = parser.parse_args(arguments)
    load = [os.getloadavg()[0]]
    with tempfile.TemporaryDirectory() as folder:
        run = Run({}, QUICK if options.quick else FULL, Path(folder))
        run.libraries, missing = libraries(run.say)
        run.remarks += [f"missing: {title}: {reason}" for title, reason in missing.items()]
        for name in SECTIONS:
            if not options.only or {name, name.partition(":")[0]} & set(options.only):
                run.measure(name, SECTIONS[name])
    load.append(os.getloadavg()[0])
    text = redacted(report.page(run.rows, run.libraries, list(machine()), load, run.remarks))
    print(text)
    if not options.only:
        write(text, FETCHED / "results" if options.quick else RESULTS)
    return 0


def write(text: str, folder: Path) -> None:
    """Write a report, named after this machine."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = re.sub(r"[^a-z0-9]+", "-", f"{_cpu()} {os.cpu_count()} cores".lower()).strip("-")
    (folder / f"{stem}.md").write_text(text)
    print(f"wrote {folder.relative_to(ROOT)}/{stem}.md")


def _cpu() -> str:
    found = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.M)
    return found[1] if found else platform.machine()


def machine() -> Iterable[str]:
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    system = platform.freedesktop_os_release().get("PRETTY_NAME", platform.system())
    yield f"{_cpu()}, {os.cpu_count()} cores, {memory:.0f} GiB; {system}, kernel {platform.release()}"
    described = ["git", "-C", str(ROOT), "describe", "--always", "--dirty"]
    commit = subprocess.run(described, capture_output=True, text=True).stdout.strip() or "unknown"
    now = datetime.datetime.now(datetime.timezone.utc)
    yield f"{now:%Y-%m-%d %H:%M} UTC, CPython {platform.python_version()}, commit {commit}"


def redacted(text: str) -> str:
    """Without the paths of this machine and the addresses of its registries, which some errors name."""
    text = re.sub(r"\b(?:https?|file)://[^\s\"']+", "(an address)", text)
    for path in (ROOT, Path(sys.prefix), Path.home()):
        text = text.replace(str(path), "...")
    return text


if __name__ == "__main__":
    sys.exit(main())
