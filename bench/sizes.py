"""Sizes of a run: everything, a quick look, or just enough to see that it runs."""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Sizes:
    rounds: int = 9
    warm_up: int = 5000  # calls before the first round
    calls: int = 4000  # a round
    queries: int = 1000  # different ones, in turn
    budget_s: float = 0.25  # of one measurement; slow libraries get fewer calls
    static_frames: int = 500
    dynamic_frames: tuple[int, ...] = (100, 300)
    seconds: float = 10.0  # of history at 100 Hz
    depths: tuple[int, ...] = (10, 1000, 6000)  # samples per frame
    growth_samples: tuple[int, ...] = (100, 1000, 10_000, 100_000)
    growth_frames: tuple[int, ...] = (10, 100, 1000, 10_000)
    growth_ancestors: tuple[int, ...] = (10, 50, 100, 500)
    vector_times: int = 10_000
    vector_pairs: int = 10
    points: int = 100_000
    inserts: int = 5000
    waiters: int = 10_000
    ring_samples: int = 40_000
    resident_samples: int = 500_000
    receive_rounds: int = 7
    # Messages beforehand; from then on each drops an old sample, as in a program that runs for long.
    receive_filling: int = 700
    receive_s: float = 5.0  # of publishing, for each load in each round
    receive_wakes: int = 200  # lookups of each kind in each round
    receive_paced: int = 500  # lookups with pauses between them, of each kind in each round
    receive_flood_rounds: int = 2
    receive_flood_s: float = 5.0  # of messages of which none may be lost
    receive_unread_s: float = 60.0  # the same with nobody reading
    receive_held_s: float = 2.0  # the same while a C call keeps the GIL
    online_rounds: int = 5
    online_frames: int = 300
    online_s: float = 8.0  # of lookups, for each number of hops in each round
    nodes_rounds: int = 3
    nodes: int = 20
    recording_transforms: int = 1_000_000
    recording_frames: int = 100
    recording_rounds: int = 5
    recording_lookups: int = 100_000
    recording_files: int = 32  # with fewer, the start of the workers counts too much
    thorough: bool = True  # every library in every section


FULL = Sizes()

QUICK = replace(
    FULL,
    rounds=5,
    calls=1000,
    queries=500,
    budget_s=0.03,
    dynamic_frames=(100,),
    growth_samples=(100, 10_000, 100_000),
    growth_frames=(10, 1000, 10_000),
    growth_ancestors=(10, 500),
    vector_pairs=4,
    inserts=2000,
    ring_samples=20_000,
    resident_samples=100_000,
    receive_rounds=1,
    receive_filling=200,
    receive_s=0.6,
    receive_wakes=60,
    receive_paced=50,
    receive_flood_rounds=1,
    receive_flood_s=0.5,
    receive_unread_s=1.0,
    online_rounds=1,
    online_s=1.0,
    nodes_rounds=1,
    nodes=4,
    recording_transforms=100_000,
    recording_rounds=2,
    recording_files=2,
    thorough=False,
)

TINY = replace(
    QUICK,
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
    ring_samples=10_100,
    resident_samples=11_000,
    receive_filling=20,
    receive_s=0.2,
    receive_wakes=5,
    receive_paced=10,
    receive_flood_s=0.1,
    receive_unread_s=0.1,
    receive_held_s=0.3,
    online_frames=60,
    online_s=0.1,
    nodes=2,
    recording_transforms=2000,
    recording_frames=40,
    recording_rounds=1,
    recording_lookups=20,
)
