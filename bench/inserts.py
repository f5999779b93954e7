"""Owns the sections on inserting: into full histories, beside waiters; and the memory that samples take."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from bench.processes import Failure
from bench.race import OURS, Entry, Row, Rows, Run, Sample, ratio_of_rounds, sample_of
from bench.trees import bushy, chain

FRAMES = 50
CACHE_S = 10.0
OUR_WAYS = ("set_transform", "set_transforms", "set_transforms_cdr", "set_transforms_cdr of 1")
CANNOT_INSERT = ("pytransform3d",)
BESIDE_WAITERS = "set_transform beside waiters"

MEMORY_SAMPLES = 10_000  # of one frame: 100 s, for schiebung keeps 120 s


def inserts(run: Run) -> None:
    """By message, batch and serialised message; and beside waiting futures."""
    sizes = run.sizes
    run.say("inserts: filling histories")
    # Longer than the cache, so that every insert drops an old sample, as in a program that runs for long.
    tree = bushy(f"inserts {FRAMES}", FRAMES + 1, 1.0, round(CACHE_S * 100) + 100)
    tree.cache_s = CACHE_S
    keys = run.load(tree, [who for who in run.with_lookups() if who not in CANNOT_INSERT])
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


def waiters(run: Run) -> None:
    """Inserts beside waiters of every kind that they do not answer."""
    sizes = run.sizes

    with run.process("waiting.py") as process:
        kinds = process.ask("kinds")

        def measure(kind: str) -> Iterator[Sample]:
            run.say(f"waiters: {sizes.waiters} that wait for: {kind}")
            pending = process.ask("prepare", kind, sizes.waiters)["pending"]
            for into in kinds["into"]:
                order = "insert", kind, into, sizes.waited_inserts, sizes.budget_s / 10
                answer = process.ask(*order)
                if not pending == answer["pending"] == sizes.waiters:
                    raise Failure(f"of {sizes.waiters} that wait for {kind}, not all do beside {into}")
                for count, key in (0, "alone"), (sizes.waiters, "beside"):
                    labels = {"waiting_for": kind, "waiters": count}
                    yield sample_of({**answer, "ns": answer[key]}, OURS, into, labels)

        run.race("waiters", [Entry(OURS, partial(measure, kind)) for kind in kinds["waiting_for"]])


def waiters_ratios(rows: Rows) -> dict[str, dict[str, float]]:
    """By what waiters wait for and what is inserted: beside the waiters over beside none."""
    ratios: dict[str, dict[str, float]] = {}
    alone: dict[tuple[str, str], Row] = {}
    for row in rows:
        if row.section == "waiters":
            kind = row.labels["waiting_for"]
            before = alone.setdefault((kind, row.way), row)
            if before is not row:
                ratios.setdefault(kind, {})[row.way] = ratio_of_rounds(row, before)
    return ratios


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
    processes = [Entry(who, partial(of_a_process, who)) for who in run.with_lookups()]
    run.race("memory", [Entry(OURS, of_one_ring), *processes], rounds=1)
