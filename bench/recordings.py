"""Measure recordings: loading one, looking up in it, pickling it, and several at once."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.processes import Process
from bench.race import OURS, Entry, Run, Sample, set_name
from bench.trees import Tree, bushy, queries_of, vector_queries_of

SECTION = "recordings"
HOPS = 4
WORKERS = (1, 2)
COMPRESSIONS = ("none", "zstd")
PER_MESSAGE = (1, 5, 50)

RAW, LOAD = "rosbags, raw messages", "bag.load"
LOOKUP, VECTOR = "lookup_transform", "lookup_transforms"
PICKLE = {"pickle": 0, "pickle, arrays apart": 1}
BATCH, NOT_READING = "map_recordings", "map_recordings, not reading"


class File(NamedTuple):
    """A recording of the section's tree."""

    path: Path
    per_message: int
    compression: str
    transforms: int


def recordings(run: Run) -> None:
    """A million transforms of a hundred frames: loading, lookups, pickles; then several at once."""
    sizes = run.sizes
    samples = sizes.recording_transforms // sizes.recording_frames
    tree = bushy(SECTION, sizes.recording_frames + 1, 1.0, samples)
    path = tree.write(run.folder)
    files = list(_written(run, path))
    with run.process("ours.py") as ours:
        with run.process("recorded.py", "rosbags") as raw:
            run.say("recordings: loading")
            ways = (RAW, raw), (LOAD, ours)
            entries = [Entry(OURS, partial(_load, *way, path, file)) for file in files for way in ways]
            run.race(SECTION, entries, sizes.recording_rounds)
        run.say("recordings: lookups")
        _race_lookups(run, tree, ours)
        run.say("recordings: pickles")
        entries = [
            Entry(OURS, partial(_pickle, ours, way, samples * sizes.recording_frames)) for way in PICKLE
        ]
        run.race(SECTION, entries, sizes.recording_rounds)
    run.say("recordings: several at once")
    run.race(SECTION, [Entry(OURS, partial(_map, run, tree, files[0]))], rounds=1)


def _load(way: str, process: Process, tree: Path, file: File) -> Iterator[Sample]:
    answer = process.ask("load_recording", tree, file.path)
    labels = {"per message": file.per_message, "compression": file.compression}
    yield Sample(OURS, way, labels, [answer["ns"] / file.transforms])


def _written(run: Run, tree: Path) -> Iterator[File]:
    with run.process("recorded.py", "writer") as process:
        for compression in COMPRESSIONS:
            for per_message in PER_MESSAGE:
                run.say(f"recordings: writing {per_message} a message, compression {compression}")
                path = run.folder / f"{compression}-{per_message}.mcap"
                order = ("write", tree, path, compression, per_message, run.sizes.recording_transforms)
                yield File(path, per_message, compression, process.ask(*order)["transforms"])


def _race_lookups(run: Run, tree: Tree, ours: Process) -> None:
    """In what was loaded last; one by one, and in one call."""
    count = run.sizes.recording_lookups
    times = tree.random_times(count, seed=1)
    pairs = tree.pairs(HOPS, run.sizes.vector_pairs, seed=HOPS, must_move=True)
    labels = {"hops": HOPS, "lookups": count}
    name = set_name(SECTION, labels)
    entries = []
    for way, title, queries, per in (
        ("core", LOOKUP, queries_of(pairs, times), 1),
        ("vector", VECTOR, vector_queries_of(pairs[:1], [np.sort(times)]), count),
    ):
        ours.ask("prepare", way, name, run.write(queries), 0)
        order = ("time", way, name, count // per)
        entries.append(run.timed(OURS, title, labels, order, per, process=ours))
    run.race(SECTION, entries, run.sizes.recording_rounds)


def _pickle(ours: Process, way: str, samples: int) -> Iterator[Sample]:
    answer = ours.ask("pickle", PICKLE[way])
    yield Sample(OURS, way, {"samples": samples}, [answer["ns"]])


def _map(run: Run, tree: Tree, file: File) -> Iterator[Sample]:
    """Recordings per second with one and two workers, and the share of one's time that is not reading."""
    target, source = (tree.names[frame] for frame in tree.pairs(HOPS, 1, seed=HOPS, must_move=True)[0])
    count = run.sizes.recording_files
    folder = run.folder / "several"
    folder.mkdir()
    paths = [folder / f"{i}.mcap" for i in range(count)]
    for path in paths:
        path.hardlink_to(file.path)
    labels = {"recordings": count, "transforms": file.transforms}
    seconds: dict[int, float] = {}
    for workers in WORKERS:
        with run.process("ours.py") as process:
            out = run.folder / f"tables-{workers}"
            answer = process.ask("map_recordings", paths, target, source, out, workers)
        seconds[workers] = answer["ns"] / 1e9
        yield Sample(OURS, BATCH, {**labels, "workers": workers}, [count / seconds[workers]], "/s")
    read_s = count * run.rows.median(SECTION, OURS, RAW, **{"per message": 1, "compression": "none"})
    read_s *= run.sizes.recording_transforms / 1e9
    yield Sample(OURS, NOT_READING, labels, [1.0 - read_s / seconds[1]], "x")
