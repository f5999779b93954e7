"""Owns how much is measured: everything, a quick look, or just enough to see that it runs."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Sizes:
    rounds: int
    warm_up: int  # calls before the first round
    calls: int  # a round
    queries: int  # different ones, asked in turn
    budget_s: float  # of one measurement; slow libraries get fewer calls
    static_frames: int
    dynamic_frames: tuple[int, ...]
    seconds: float  # of history at 100 Hz
    depths: tuple[int, ...]  # samples per frame
    growth_samples: tuple[int, ...]
    growth_frames: tuple[int, ...]
    growth_ancestors: tuple[int, ...]
    vector_times: int
    vector_pairs: int
    points: int
    inserts: int
    waiters: int
    waited_inserts: int  # beside the waiters, of each kind, a round
    failing_frames: tuple[int, int]
    load_rounds: int
    load_s: float  # of one round
    load_calls: int  # in each thread, a round
    load_messages: int  # beside readers
    ring_samples: int
    resident_samples: int
    thorough: bool  # every library in every part; instructions are counted


FULL = Sizes(
    rounds=9,
    warm_up=5000,
    calls=4000,
    queries=1000,
    budget_s=0.25,
    static_frames=500,
    dynamic_frames=(100, 300),
    seconds=10.0,
    depths=(10, 1000, 6000),
    growth_samples=(100, 1000, 10_000, 100_000),
    growth_frames=(10, 100, 1000, 10_000),
    growth_ancestors=(10, 50, 100, 500),
    vector_times=10_000,
    vector_pairs=10,
    points=100_000,
    inserts=5000,
    waiters=10_000,
    waited_inserts=500,
    failing_frames=(10, 100_000),
    load_rounds=5,
    load_s=1.0,
    load_calls=20_000,
    load_messages=1000,
    ring_samples=40_000,
    resident_samples=500_000,
    thorough=True,
)

QUICK = Sizes(
    rounds=5,
    warm_up=5000,
    calls=1000,
    queries=500,
    budget_s=0.05,
    static_frames=500,
    dynamic_frames=(100,),
    seconds=10.0,
    depths=(10, 1000, 6000),
    growth_samples=(100, 10_000, 100_000),
    growth_frames=(10, 1000, 10_000),
    growth_ancestors=(10, 500),
    vector_times=10_000,
    vector_pairs=4,
    points=100_000,
    inserts=2000,
    waiters=10_000,
    waited_inserts=500,
    failing_frames=(10, 100_000),
    load_rounds=2,
    load_s=0.5,
    load_calls=10_000,
    load_messages=200,
    ring_samples=20_000,
    resident_samples=200_000,
    thorough=False,
)

TINY = Sizes(
    rounds=1,
    warm_up=10,
    calls=20,
    queries=10,
    budget_s=0.05,
    static_frames=60,
    dynamic_frames=(60,),
    seconds=0.2,
    depths=(10, 20),
    growth_samples=(10, 20),
    growth_frames=(10, 60),
    growth_ancestors=(5, 10),
    vector_times=20,
    vector_pairs=2,
    points=50,
    inserts=100,
    waiters=10,
    waited_inserts=10,
    failing_frames=(5, 50),
    load_rounds=1,
    load_s=0.1,
    load_calls=1000,
    load_messages=10,
    ring_samples=10_100,
    resident_samples=11_000,
    thorough=False,
)
