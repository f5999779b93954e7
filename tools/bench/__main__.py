# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure the tools, with the benchmark of the core: `make -C tools bench` prints and writes a report."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

from bench import report
from bench.__main__ import Run, Section, machine, redacted, write
from bench.libraries import FETCHED, OURS, ours
from bench.run_sizes import FULL, QUICK

HERE = Path(__file__).resolve().parent

SECTIONS = {
    "recordings": Section("recordings.recordings", (OURS,), rounds=5),
    "recordings:several": Section("recordings.several", (OURS,), rounds=1),
    "live:cpu": Section("live.cpu", (OURS,), ["listener", "dds://"]),
    "live:waits": Section("live.waits", (OURS,), ["listener", "dds://"]),
}
TITLES = {
    "recordings": "Recordings, µs per transform, per lookup, per pickle and back",
    "recordings:several": "Recordings per second, by workers",
    "live:cpu": "CPU of a process per message it receives from a robot while nothing waits, µs",
    "live:waits": "How soon a waiting lookup returns after another process has sent, µs",
}
FULL_SIZES = FULL | {
    "recording_transforms": 1_000_000,
    "recording_frames": 100,
    "recording_lookups": 100_000,
    "recording_files": 32,  # with fewer, the start of the workers counts too much
}
QUICK_SIZES = FULL_SIZES | QUICK | {"recording_transforms": 100_000, "recording_files": 2}


def main() -> int:
    parser = argparse.ArgumentParser(prog="make -C tools bench", description="Measure recordings and feeds.")
    parser.add_argument("--quick", action="store_true", help="fewer rounds and sizes")
    parser.add_argument("--only", choices=SECTIONS, nargs="+", metavar="SECTION", help="and write no files")
    options = parser.parse_args()
    load = [os.getloadavg()[0]]
    library = ours()
    path = library.environment["PYTHONPATH"]
    library.environment["PYTHONPATH"] = os.pathsep.join([str(HERE), str(HERE.parent), path])
    with tempfile.TemporaryDirectory() as folder:
        run = Run({OURS: library}, QUICK_SIZES if options.quick else FULL_SIZES, Path(folder))
        for name in options.only or SECTIONS:
            run.measure(name, SECTIONS[name])
    load.append(os.getloadavg()[0])
    text = redacted(report.page(run.rows, run.libraries, list(machine()), load, run.remarks, TITLES))
    print(text)
    if options.only:
        return 0
    write(text, (FETCHED if options.quick else HERE) / "results")
    return 0


if __name__ == "__main__":
    sys.exit(main())
