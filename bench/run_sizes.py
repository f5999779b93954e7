# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sizes of a run: everything, or a quick look."""

from typing import Any

FULL: dict[str, Any] = {
    "rounds": 5,  # at most; sections that take long have fewer
    "warm_up": 5000,  # calls before those that count
    "calls": 4000,  # in a round
    "queries": 1000,  # different ones, in turn
    "budget_s": 0.25,  # of one measurement; slow libraries get fewer calls
    "static_frames": 500,
    "dynamic_frames": (100, 300),
    "seconds": 10.0,  # of history at 100 Hz
    "depths": (100, 1000, 10_000, 100_000),  # samples per frame
    "vector_times": 10_000,
    "vector_pairs": 10,
    "inserts": 5000,
    "resident_samples": 500_000,
    # Messages beforehand; from then on each drops an old sample, as in a program that runs for long.
    "filling": 700,
    "receive_s": 3.0,  # of publishing, for each load in each round
    "wakes": 200,  # lookups of each kind in each round
    "evaluated_frames": 500,
    "online_frames": 300,
    "online_s": 5.0,  # of lookups, for each number of hops in each round
    "nodes": 10,
    "frozen_samples": 5_000_000,
    "frozen_frames": 50,
}

QUICK = FULL | {
    "rounds": 1,
    "calls": 1000,
    "queries": 500,
    "budget_s": 0.03,
    "dynamic_frames": (100,),
    "evaluated_frames": 100,
    "depths": (100, 10_000),
    "vector_pairs": 4,
    "inserts": 2000,
    "resident_samples": 100_000,
    "filling": 200,
    "receive_s": 0.6,
    "wakes": 60,
    "online_s": 1.0,
    "nodes": 4,
    "frozen_samples": 500_000,
}
