"""Owns the section on recordings: loading one, looking up in it, pickling it, and several of them at once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.processes import Process
from bench.race import CHECKED, OURS, Entry, Run, Sample, largest_deviation, set_name
from bench.trees import Tree, bushy, queries_of, vector_queries_of

SECTION = "recordings"
HOPS = 4
WORKERS = (1, 2)
COMPRESSIONS = ("none", "zstd")
PER_MESSAGE = (1, 5, 50)

RAW, LOAD = "rosbags, raw messages", "bag.load"
LISTS, DECODED, SCHIEBUNG = "rosbags + lists", "mcap-ros2-support + lists", "rosbags + schiebung"
LOOKUP, VECTOR = "lookup_transform", "lookup_transforms"
PICKLE = {"pickle": 0, "pickle, arrays apart": 1}
BATCH, NOT_READING = "map_recordings", "map_recordings, not reading"


class File(NamedTuple):
    """A recording of the section's tree."""

    path: Path
    per_message: int
    compression: str
    transforms: int


class Contender(NamedTuple):
    """A process that loads recordings."""

    who: str
    way: str
    process: Process

    def load(self, tree: Path, file: File) -> Iterator[Sample]:
        answer = self.process.ask("load_recording", tree, file.path)
        labels = {"per message": file.per_message, "compression": file.compression}
        yield Sample(self.who, self.way, labels, [answer["ns"] / file.transforms])


def recordings(run: Run) -> None:
    """A million transforms of a hundred frames: loading, lookups, pickles; then several at once."""
    sizes = run.sizes
    samples = sizes.recording_transforms // sizes.recording_frames
    tree = bushy(SECTION, sizes.recording_frames + 1, 1.0, samples)
    path = tree.write(run.folder)
    with ExitStack() as stack:

        def contender(way: str, program: str, *arguments: str, who: str = OURS) -> Contender:
            return Contender(who, way, stack.enter_context(run.process(program, *arguments, who=who)))

        ours = contender(LOAD, "ours.py")
        others = [
            contender(LISTS, "recorded.py", "rosbags + lists"),
            contender(DECODED, "recorded.py", "mcap + lists"),
        ]
        if "schiebung" in run.libraries:
            others.append(contender(SCHIEBUNG, "from_pypi.py", "schiebung", who="schiebung"))
        files = list(_written(run, path))
        with run.process("recorded.py", "rosbags") as process:
            raw = Contender(OURS, RAW, process)
            run.say("recordings: loading")
            entries = [Entry(one.who, partial(one.load, path, file)) for file in files for one in (raw, ours)]
            run.race(SECTION, entries, sizes.recording_rounds)
        # Once, and without compression: they take many times as long.
        for file in files[: len(PER_MESSAGE)]:
            run.say(f"recordings: loading {file.per_message} a message by others")
            run.race(SECTION, [Entry(one.who, partial(one.load, path, file)) for one in others], rounds=1)
        run.say("recordings: lookups")
        _race_lookups(run, tree, [ours, *others])
        run.say("recordings: pickles")
        entries = [
            Entry(OURS, partial(_pickle, ours, way, samples * sizes.recording_frames)) for way in PICKLE
        ]
        run.race(SECTION, entries, sizes.recording_rounds)
    run.say("recordings: several at once")
    run.race(SECTION, [Entry(OURS, partial(_map, run, tree, files[0]))], rounds=1)


def _written(run: Run, tree: Path) -> Iterator[File]:
    with run.process("recorded.py", "writer") as process:
        for compression in COMPRESSIONS:
            for per_message in PER_MESSAGE:
                run.say(f"recordings: writing {per_message} a message, compression {compression}")
                path = run.folder / f"{compression}-{per_message}.mcap"
                order = ("write", tree, path, compression, per_message, run.sizes.recording_transforms)
                yield File(path, per_message, compression, process.ask(*order)["transforms"])


def _race_lookups(run: Run, tree: Tree, contenders: list[Contender]) -> None:
    """In what each has loaded last, over the same frames at the same times; ours also in one call."""
    count = run.sizes.recording_lookups
    times = tree.random_times(count, seed=1)
    pairs = tree.pairs(HOPS, run.sizes.vector_pairs, seed=HOPS, must_move=True)
    labels = {"hops": HOPS, "lookups": count}
    truth: list[list[float] | None] = []
    entries = []
    for one in contenders:
        for way, queries, per in (
            ("core", queries_of(pairs, times), 1),
            ("vector", vector_queries_of(pairs[:1], [np.sort(times)]), count),
        ):
            if way == "vector" and one.way != LOAD:
                continue
            name = set_name(SECTION, labels)
            answers = one.process.ask("prepare", way, name, run.write(queries), CHECKED)["answers"]
            truth = truth or answers
            deviation = largest_deviation(truth, answers) if way == "core" else None
            title = {"core": LOOKUP, "vector": VECTOR}[way] if one.way == LOAD else one.way
            calls = count // per
            order = ("time", way, name, calls)
            entries.append(run.timed(one.who, title, labels, order, per, deviation, one.process))
    run.race(SECTION, entries, run.sizes.recording_rounds)


def _pickle(ours: Contender, way: str, samples: int) -> Iterator[Sample]:
    answer = ours.process.ask("pickle", PICKLE[way])
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
