# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
The benchmark's command line: `python -m bench [--quick]` measures, prints, and writes a report.

`python -m bench --only inserts receiving:cpu` measures sections, and only prints; with `--renew`, it puts
them into the report.
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
import sysconfig
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
    rounds: int = 5  # at most


SECTIONS = {
    "lookups": Section("lookups.lookups", EVERY),
    "calls": Section("calls.calls", ROS2),
    "vectors": Section("lookups.vectors", (OURS, "tf_tree")),
    "inserts": Section("inserts_and_memory.inserts", EVERY),
    "clouds": Section("clouds.clouds", (OURS,)),
    "memory": Section("inserts_and_memory.memory", EVERY, rounds=1),
    "receiving:cpu": Section(
        "receiving_and_waiting.cpu",
        ROS2,
        ["listener", "spin_once", "executor.spin_once", "spin_once+lookup"],
        ["overridden"],
        rounds=3,
    ),
    "receiving:waits": Section("receiving_and_waiting.waits", ROS2, ["blocked", "own insert"], rounds=3),
    "tf2_rs:offline": Section("lookups.as_evaluated", (OURS, "ros2", "tf2_cpp")),
    "tf2_rs:online": Section("lookups_while_receiving.online", ROS2, rounds=3),
    "nodes": Section("many_nodes.many", (OURS,), ["apart", "together"], rounds=3),
    "frozen": Section("frozen_files.frozen", (OURS,), rounds=3),
}


class Run:
    """Measure sections, round by round; `rows` are the results."""

    def __init__(self, found: dict[str, Library], sizes: dict[str, Any], folder: Path) -> None:
        self.libraries, self.sizes = found, sizes | {"folder": str(folder)}
        self.rows = report.Rows()
        self._out = folder / "rows.json"
        self._began = time.monotonic()

    def say(self, text: str) -> None:
        print(f"{time.monotonic() - self._began:6.1f} s  {text}", file=sys.stderr, flush=True)

    def measure(self, name: str, section: Section) -> list[str]:
        """Measure a section; where, how often, at which load, and what failed."""
        takers = [who for who in section.libraries if who in self.libraries]
        entries = [(who, variant) for variant in section.variants for who in takers]
        entries += [(OURS, variant) for variant in section.ours_only]
        rounds = min(section.rounds, self.sizes["rounds"])
        before, began, failures = os.getloadavg()[0], datetime.datetime.now(datetime.timezone.utc), []
        for turn in range(rounds):
            # Each round begins with another one, and whoever fails takes part no longer.
            for entry in entries[turn % len(entries) :] + entries[: turn % len(entries)]:
                self.say(f"{name}, round {turn + 1}: {' '.join(entry)}")
                if (problem := self._run(name, section.function, *entry)) is not None:
                    failures.append(f"{self.libraries[entry[0]].title} had to leave: {problem}")
                    entries.remove(entry)
        load = f"load average before and after: {before:.1f}, {os.getloadavg()[0]:.1f}"
        where = f"`python -m bench --only {name}`, {rounds} rounds".replace(" 1 rounds", " 1 round")
        return [f"{where}; commit {commit()}, {began:%Y-%m-%d %H:%M} UTC; {load}", *failures]

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
    parser.add_argument("--renew", action="store_true", help="with --only: put the sections into the report")
    parser.add_argument("--rounds", type=int, help="at most so many")
    options = parser.parse_args(arguments)
    sizes = QUICK if options.quick else FULL
    sizes = sizes | {"rounds": options.rounds or sizes["rounds"]}
    path = (FETCHED / "results" if options.quick else RESULTS) / f"{_stem()}.md"
    commit()  # of the code before the report changes
    with tempfile.TemporaryDirectory() as folder:
        run = Run({}, sizes, Path(folder))
        run.libraries, missing = libraries(run.say)
        head = redacted(report.head(run.libraries, list(machine()), missing))
        print(head)
        kept = path.read_text() if path.exists() else head
        if report.head_of(kept) != head:
            if options.renew:
                parser.error(f"{path.name} is of other libraries, or of another machine: run without --only")
            kept = head
        for name in SECTIONS:
            if not options.only or {name, name.partition(":")[0]} & set(options.only):
                remarks = run.measure(name, SECTIONS[name])
                section = redacted(report.section(name, run.rows.of(name), run.libraries, remarks))
                print(section)
                if not run.rows.of(name):
                    return 1
                kept = report.with_section(kept, section)
                # At once, because a whole run takes long.
                if options.renew or not options.only:
                    path.parent.mkdir(parents=True, exist_ok=True)
                    path.write_text(kept)
                    run.say(f"wrote {path.relative_to(ROOT)}")
    return 0


def _stem() -> str:
    """The name of this machine's report."""
    return re.sub(r"[^a-z0-9]+", "-", f"{_cpu()} {os.cpu_count()} cores".lower()).strip("-")


def _cpu() -> str:
    found = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.M)
    return found[1] if found else platform.machine()


def machine() -> Iterable[str]:
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    system = platform.freedesktop_os_release().get("PRETTY_NAME", platform.system())
    kernel = platform.release().partition("-")[0]
    yield f"{_cpu()}, {os.cpu_count()} cores, {memory:.0f} GiB; {system}, kernel {kernel}"
    optimized = "--enable-optimizations" in (sysconfig.get_config_var("CONFIG_ARGS") or "")
    yield f"CPython {platform.python_version()}{'' if optimized else ' (built without PGO)'}"


@cache
def commit() -> str:
    """The commit of the code; pages, which may have changed since, are no part of it."""
    git = ["git", "-C", str(ROOT)]
    found = subprocess.run([*git, "rev-parse", "--short=8", "HEAD"], capture_output=True, text=True)
    changed = subprocess.run([*git, "diff", "--quiet", "HEAD", "--", ":!*.md", ":!docs"]).returncode
    return (found.stdout.strip() or "unknown") + "-dirty" * bool(changed)


def redacted(text: str) -> str:
    """Without the paths of this machine and the addresses of its registries, which some errors name."""
    text = re.sub(r"\b(?:https?|file)://[^\s\"']+", "(an address)", text)
    for path in (ROOT, Path(sys.prefix), Path.home()):
        text = text.replace(str(path), "...")
    return text


if __name__ == "__main__":
    sys.exit(main())
