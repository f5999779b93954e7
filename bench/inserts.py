"""Measure inserts into full histories and beside waiters, and the memory that samples take."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from bench.processes import Failure
from bench.race import OURS, Entry, Run, Sample, sample_of
from bench.trees import bushy, chain

FRAMES = 50
CACHE_S = 10.0
OUR_WAYS = ("set_transform", "set_transforms", "set_transforms_cdr", "set_transforms_cdr of 1")
BESIDE_WAITERS = "set_transform beside waiters"

MEMORY_SAMPLES = 10_000  # of one frame: 100 s


def inserts(run: Run) -> None:
    """By message, batch and serialised message; and beside waiting futures."""
    sizes = run.sizes
    run.say("inserts: filling histories")
    # Longer than the cache, so that every insert drops an old sample, as in a program that runs for long.
    tree = bushy(f"inserts {FRAMES}", FRAMES + 1, 1.0, round(CACHE_S * 100) + 100)
    tree.cache_s = CACHE_S
    keys = run.load(tree, run.libraries)
    labels = {"frames": FRAMES}
    entries = [
        run.timed(who, way, labels, ("insert", way, sizes.inserts))
        for who in keys
        for way in (OUR_WAYS if who == OURS else OUR_WAYS[:1])
    ]
    run.say("inserts: rounds")
    run.race("inserts", entries)

    def beside_waiters(waiting_for: str) -> list[Sample]:
        pending = run.ask(OURS, "wait", waiting_for, sizes.waiters)["pending"]
        if pending != sizes.waiters:
            raise Failure(f"only {pending} of {sizes.waiters} wait")
        answer = run.ask(OURS, "insert", "set_transform", sizes.inserts, sizes.budget_s)
        run.ask(OURS, "stop_waiting")
        beside = {**labels, "waiters": sizes.waiters, "waiting_for": waiting_for}
        return [sample_of(answer, OURS, BESIDE_WAITERS, beside)]

    if OURS in keys:
        run.say(f"inserts: rounds beside {sizes.waiters} futures")
        order = ("insert", "set_transform", sizes.inserts)
        alone = run.timed(OURS, BESIDE_WAITERS, {**labels, "waiters": 0}, order)
        waiting = [Entry(OURS, partial(beside_waiters, what)) for what in ("unknown", "later")]
        run.race("inserts", [alone, *waiting])


def memory(run: Run) -> None:
    """Bytes per dynamic sample: what our buffer accounts for, and what each process holds."""
    sizes = run.sizes

    def of_one_ring() -> Iterator[Sample]:
        run.restart(OURS)
        ring = run.ask(OURS, "ring", sizes.ring_samples)
        for way, bytes_, samples in ("fullest", *ring["best"]), ("just grown", *ring["worst"]):
            yield Sample(OURS, f"ring, {way}", {"samples": samples}, [bytes_], "B")
        run.restart(OURS)
        worst = run.ask(OURS, "resident", sizes.resident_samples)["worst"]
        yield Sample(OURS, "resident, while growing", {"samples": sizes.resident_samples}, [worst], "B")

    def of_a_process(who: str) -> Iterator[Sample]:
        run.say(f"memory: {run.libraries[who].label}")
        run.restart(who)
        samples = sum(tree.dynamic) * tree.samples
        held = run.ask(who, "load", path, 0)["rss_bytes"]
        yield Sample(who, "resident", {"samples": samples}, [held / samples], "B")

    run.say("memory: one ring, sample by sample")
    tree = chain("memory", max(1, sizes.resident_samples // MEMORY_SAMPLES), MEMORY_SAMPLES)
    path = tree.write(run.folder)
    processes = [Entry(who, partial(of_a_process, who)) for who in run.libraries]
    run.race("memory", [Entry(OURS, of_one_ring), *processes], rounds=1)
