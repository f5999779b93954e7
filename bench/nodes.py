"""Measure lookups while another process publishes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from bench.lookups import HOPS
from bench.race import OURS, Entry, Run, Sample, with_p99
from bench.trees import Tree, bushy

ONLINE_AGE_S = 0.5  # of the times that are looked up
ONLINE_BATCH, ONLINE_PAUSE_S = 25, 0.025  # 1,000 lookups a second
ONLINE_CPU = "CPU"
PAIRS = 100


def online(run: Run) -> None:
    """The online scenario of the published evaluation: lookups while another process publishes a tree."""
    frames = run.sizes.online_frames
    tree = bushy(f"online {frames}", frames, 0.5, 2)
    path = tree.write(run.folder)
    with run.process("publishing.py") as publisher:
        publisher.ask("tree", path)
        listeners = filter(run.libraries.__contains__, (OURS, "ros2"))
        entries = [Entry(who, partial(_online, run, tree, who)) for who in listeners]
        run.race("online", entries, run.sizes.online_rounds)


def _online(run: Run, tree: Tree, who: str) -> Iterator[Sample]:
    library, seconds = run.libraries[who], run.sizes.online_s
    run.say(f"online: {library.label}")
    with run.process(Path(library.command[1]).name, who=who) as process:
        process.ask("listen", tree.cache_s, len(tree.names))
        for hops in HOPS:
            pairs = tree.pairs(hops, PAIRS, seed=hops, must_move=True)
            names = [(tree.names[target], tree.names[source]) for target, source in pairs]
            labels = {"tree": tree.name, "place": "past", "hops": hops}
            before_ns = process.cpu_ns()
            times = process.ask("online", names, ONLINE_AGE_S, ONLINE_BATCH, ONLINE_PAUSE_S, seconds)["ns"]
            yield Sample(who, ONLINE_CPU, labels, [(process.cpu_ns() - before_ns) / 1e9 / seconds], "CPU")
            yield from with_p99(who, "buffer", labels, times)
