"""Sizes of a run: everything, a quick look, or just enough to see that it runs."""

from typing import Any

FULL: dict[str, Any] = {
    "rounds": 7,  # at most; sections that take long have fewer
    "warm_up": 5000,  # calls before those that count
    "calls": 4000,  # in a round
    "queries": 1000,  # different ones, in turn
    "budget_s": 0.25,  # of one measurement; slow libraries get fewer calls
    "static_frames": 500,
    "dynamic_frames": (100, 300),
    "seconds": 10.0,  # of history at 100 Hz
    "depths": (10, 1000, 6000),  # samples per frame
    "growth_samples": (100, 1000, 10_000, 100_000),
    "growth_frames": (10, 100, 1000, 10_000),
    "growth_ancestors": (10, 50, 100, 500),
    "vector_times": 10_000,
    "vector_pairs": 10,
    "inserts": 5000,
    "waiters": (0, 10, 1000, 10_000),
    "fighting_waiters": 100,
    "queued": 1000,  # messages of a filter
    "ring_samples": 40_000,
    "resident_samples": 500_000,
    # Messages beforehand; from then on each drops an old sample, as in a program that runs for long.
    "filling": 700,
    "receive_s": 5.0,  # of publishing, for each load in each round
    "wakes": 200,  # lookups of each kind in each round
    "paced": 500,  # lookups with pauses between them
    "flood_s": 5.0,  # of messages of which none may be lost
    "unread_s": 60.0,  # the same with nobody reading
    "held_s": 2.0,  # the same while a C call keeps the GIL
    "online_frames": 300,
    "online_s": 8.0,  # of lookups, for each number of hops in each round
    "nodes": 20,
    "frozen_samples": 10_000_000,
    "frozen_frames": 50,
    "frozen_lookups": 10_000,
    "frozen_workers": 8,
}

QUICK = FULL | {
    "rounds": 1,
    "calls": 1000,
    "queries": 500,
    "budget_s": 0.03,
    "dynamic_frames": (100,),
    "growth_samples": (100, 10_000),
    "growth_frames": (10, 1000),
    "growth_ancestors": (10, 500),
    "vector_pairs": 4,
    "inserts": 2000,
    "ring_samples": 20_000,
    "resident_samples": 100_000,
    "filling": 200,
    "receive_s": 0.6,
    "wakes": 60,
    "paced": 50,
    "flood_s": 0.5,
    "unread_s": 1.0,
    "online_s": 1.0,
    "nodes": 4,
    "frozen_samples": 500_000,
    "frozen_workers": 2,
}
