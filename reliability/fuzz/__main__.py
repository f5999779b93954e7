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

from reliability.fuzz.building import built, environment
from reliability.fuzz.targets import IN_PYTHON, MOST_BYTES, PACKAGES

HERE = Path(__file__).resolve().parent
CORPUS, CRASHES = HERE / "corpus", HERE / "crashes"
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
    """Fuzz one target, from its corpus, crashes and seeds; what it finds is added to ``crashes``."""
    crashes = CRASHES / name
    crashes.mkdir(parents=True, exist_ok=True)
    before = set(crashes.iterdir())
    found = build.parent / "fuzz-corpus" / name  # what former runs found is not found again
    found.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as seeds:
        _run(["reliability.fuzz.seeding", name, seeds], build, python)
        options = [
            f"-max_total_time={seconds}",
            f"-max_len={MOST_BYTES[name]}",
            f"-timeout={INPUT_S}",
            f"-report_slow_units={INPUT_S}",
            f"-rss_limit_mb={MEMORY_MB}",
            "-malloc_limit_mb=1048576",  # the sanitizer refuses too much at once, as a machine would
            "-handle_xfsz=0",  # a target limits the sizes of files; Python makes it an OSError
            "-print_final_stats=1",
            "-verbosity=1",
            f"-artifact_prefix={crashes}/",
        ]
        places = [str(found), str(CORPUS / name), seeds]
        begun = time.monotonic()
        log = build.parent / f"fuzz-{name}.log"
        process = ["reliability.fuzz.process", name, *options, *filter(_exists, places)]
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
        name = one.with_name(f"{kind}-{hashlib.sha1(one.read_bytes()).hexdigest()[:12]}")
        one.replace(name)
        names.add(name)
    return sorted(names)


def minimise(name: str, build: Path, python: str) -> None:
    """Keep in the repository the smallest inputs that reach what the seeds do not."""
    kept = CORPUS / name
    kept.mkdir(parents=True, exist_ok=True)
    found = build.parent / "fuzz-corpus" / name
    with tempfile.TemporaryDirectory() as merged, tempfile.TemporaryDirectory() as seeds:
        _run(["reliability.fuzz.seeding", name, seeds], build, python)
        options = ["-merge=1", f"-max_len={MOST_BYTES[name]}", f"-timeout={INPUT_S}"]
        options += ["-handle_xfsz=0", "-artifact_prefix=./"]
        places = [merged, seeds, str(kept), str(found)]
        log = build.parent / f"fuzz-{name}-merge.log"
        _run(
            ["reliability.fuzz.process", name, *options, *filter(_exists, places)], build, python, log, merged
        )
        made = {one.read_bytes() for one in Path(seeds).iterdir()}
        new = sorted((one.read_bytes() for one in Path(merged).iterdir()), key=len)
        for old in kept.iterdir():
            old.unlink()
        size = 0
        for data in new:
            size += len(data)
            # The seeds are made anew each time.
            if data not in made and size <= MOST_KEPT:
                (kept / hashlib.sha1(data).hexdigest()[:12]).write_bytes(data)


def _exists(place: str) -> bool:
    return Path(place).exists()


def _run(
    arguments: list[str], build: Path, python: str, log: Path | None = None, folder: str | None = None
) -> int:
    command = [python, "-m", *arguments]
    with tempfile.TemporaryDirectory() as empty:
        options = {"cwd": folder or empty, "env": environment(build, guarded=arguments[1] not in IN_PYTHON)}
        if log is None:
            subprocess.run(command, check=True, **options)
            return 0
        with open(log, "w") as file:
            ended = subprocess.run(command, stdout=file, stderr=file, **options)
            return int(ended.returncode)


def main() -> int:
    """Fuzz the targets one after the other; 1: something was found."""
    parser = argparse.ArgumentParser(
        prog="python -m reliability.fuzz",
        description="Search for inputs that crash this package, or make it answer wrongly. What is found is"
        " written to reliability/fuzz/crashes; tests/packaging/test_fuzz.py runs it from then on.",
    )
    parser.add_argument("target", nargs="*", help=f"of {', '.join(PACKAGES)}; none: all")
    parser.add_argument("--seconds", type=int, default=600, help="for each (default: %(default)s)")
    parser.add_argument(
        "--minimise",
        action="store_true",
        help="instead, update the corpus in the repository with what was found",
    )
    arguments = parser.parse_args()
    names = arguments.target or list(PACKAGES)
    unknown = set(names) - PACKAGES.keys()
    if unknown:
        parser.error(f"there is no target {', '.join(sorted(unknown))}")
    build = built()
    lines, failed = [], False
    for name in names:
        if arguments.minimise:
            minimise(name, build, sys.executable)
            sizes = [one.stat().st_size for one in (CORPUS / name).iterdir()]
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
