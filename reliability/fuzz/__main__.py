# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of fuzzing."""

import argparse
import hashlib
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from reliability.fuzz.fuzzing_build import built, environment
from reliability.fuzz.targets import IN_PYTHON, NAMES, corpus, keep, target

INPUT_S = 20  # an input that takes longer hangs
MOST_KEPT = 40_000  # bytes of a corpus in the repository
MEMORY_MB = 2048  # that the process may need: memory grows without bound


class Outcome(NamedTuple):
    """What one run came to."""

    executions: int
    edges: int
    seconds: float
    crashes: list[Path]
    code: int  # that the process ended with


def fuzz(name: str, seconds: int, build: Path, python: str) -> Outcome:
    """Fuzz one target, from its corpus and seeds; crashes are written to ``.reliability/fuzz-crashes``."""
    crashes = build.parent / "fuzz-crashes" / name
    crashes.mkdir(parents=True, exist_ok=True)
    before = set(crashes.iterdir())
    found = build.parent / "fuzz-corpus" / name  # what former runs found is not found again
    found.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as seeds:
        _write_inputs(name, seeds)
        options = [
            f"-max_total_time={seconds}",
            f"-max_len={target(name).MOST_BYTES}",
            f"-timeout={INPUT_S}",
            f"-report_slow_units={INPUT_S}",
            f"-rss_limit_mb={MEMORY_MB}",
            "-malloc_limit_mb=1048576",  # the sanitizer refuses too much at once, as a machine would
            "-handle_xfsz=0",  # a target limits the sizes of files; Python makes it an OSError
            "-print_final_stats=1",
            "-verbosity=1",
            f"-artifact_prefix={crashes}/",
        ]
        places = [str(found), seeds]
        begun = time.monotonic()
        log = build.parent / f"fuzz-{name}.log"
        process = ["reliability.fuzz.fuzz_one", name, *options, *places]
        code = _run(process, build, python, log)
        took = time.monotonic() - begun
    text = log.read_text(errors="replace")
    executions = [int(number) for number in re.findall(r"^#(\d+)\s", text, re.M)]
    executions += map(int, re.findall(r"number_of_executed_units: (\d+)", text))
    edges = [int(number) for number in re.findall(r"\bcov: (\d+)", text)]
    new = _named(set(crashes.iterdir()) - before)
    if new or code != 0:
        print(text[-6000:])
    return Outcome(max(executions, default=0), max(edges, default=0), took, new, code)


def _named(files: set[Path]) -> list[Path]:
    # By the kind of fault and by the content: an exception was written twice.
    names = set()
    for one in files:
        kind = "crash" if one.name.startswith("exception") else one.name.partition("-")[0]
        name = one.with_name(f"{kind}-{_digest(one)}")
        one.replace(name)
        names.add(name)
    return sorted(names)


def minimize(name: str, build: Path, python: str) -> None:
    """Keep in the repository the smallest inputs that reach what the seeds do not."""
    found = [build.parent / folder / name for folder in ("fuzz-corpus", "fuzz-crashes")]
    with tempfile.TemporaryDirectory() as merged, tempfile.TemporaryDirectory() as seeds:
        made = _write_inputs(name, seeds)
        options = ["-merge=1", f"-max_len={target(name).MOST_BYTES}", f"-timeout={INPUT_S}"]
        options += ["-handle_xfsz=0", "-artifact_prefix=./"]
        places = [merged, seeds, *(str(folder) for folder in found if folder.exists())]
        log = build.parent / f"fuzz-{name}-merge.log"
        _run(["reliability.fuzz.fuzz_one", name, *options, *places], build, python, log, merged)
        crashes = found[1].iterdir() if found[1].exists() else ()
        kept = {one: data for one, data in corpus(name).items() if one.startswith("crash")}
        kept |= {f"crash-{_digest(one)}": one.read_bytes() for one in crashes}
        size = 0
        for one in sorted(Path(merged).iterdir(), key=lambda path: path.stat().st_size):
            size += one.stat().st_size
            # The seeds are made anew each time.
            if size <= MOST_KEPT and one.read_bytes() not in made:
                kept[_digest(one)] = one.read_bytes()
    keep(name, kept)


def _write_inputs(name: str, folder: str) -> set[bytes]:
    """Write the seeds of a target and its corpus to a folder; return the seeds."""
    seeds = list(target(name).seeds())
    inputs = {f"seed-{number:03}": seed for number, seed in enumerate(seeds)} | corpus(name)
    for one, data in inputs.items():
        Path(folder, one).write_bytes(data)
    return set(seeds)


def _digest(path: Path) -> str:
    return hashlib.sha1(path.read_bytes()).hexdigest()[:12]


def _run(arguments: list[str], build: Path, python: str, log: Path, folder: str | None = None) -> int:
    environ = environment(build, guarded=arguments[1] not in IN_PYTHON)
    with tempfile.TemporaryDirectory() as empty, open(log, "w") as file:
        command = [python, "-m", *arguments]
        return subprocess.run(command, stdout=file, stderr=file, cwd=folder or empty, env=environ).returncode


def main() -> int:
    """Fuzz the targets one after the other; 1: something was found."""
    parser = argparse.ArgumentParser(
        prog="python -m reliability.fuzz",
        description="Search for inputs that crash this package, or make it answer wrongly. What is found is"
        " written to .reliability/fuzz-crashes; --minimize adds it to the corpus, which"
        " tests/packaging/test_fuzz_corpus.py runs from then on.",
    )
    parser.add_argument("target", nargs="*", help=f"of {', '.join(NAMES)}; none: all")
    parser.add_argument("--seconds", type=int, default=600, help="for each (default: %(default)s)")
    parser.add_argument(
        "--minimize",
        action="store_true",
        help="instead, update the corpus in the repository with what was found",
    )
    arguments = parser.parse_args()
    names = arguments.target or NAMES
    unknown = set(names) - set(NAMES)
    if unknown:
        parser.error(f"there is no target {', '.join(sorted(unknown))}")
    build = built()
    lines, failed = [], False
    for name in names:
        if arguments.minimize:
            minimize(name, build, sys.executable)
            sizes = [len(data) for data in corpus(name).values()]
            lines.append(f"{name}: {len(sizes)} inputs, {sum(sizes)} bytes")
            continue
        outcome = fuzz(name, arguments.seconds, build, sys.executable)
        failed = failed or bool(outcome.crashes) or outcome.code != 0
        found = ", ".join(one.name for one in outcome.crashes)
        lines.append(
            f"{name}: {outcome.executions} executions, {outcome.edges} edges, {outcome.seconds:.0f} s, "
            + (found or ("nothing found" if outcome.code == 0 else f"ended with {outcome.code}"))
        )
        print(lines[-1], flush=True)
    print("\n".join(["", *lines]))
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
