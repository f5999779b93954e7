"""What a soak makes of its samples: it sees the leaks that it promises to see, and no others."""

import random

import pytest

from reliability.latencies import Latencies
from reliability.soak import judgements

EVERY_S = 2
AWAITS_HZ = 100
NOISE = {"resident": 2e6, "heap": 1e6, "blocks": 1500, "threads": 1, "descriptors": 1}


def samples(minutes, **rise_per_second):
    """As of a node that grows by so much, has noise, once was far off for some seconds, and had one step."""
    rng = random.Random(1)
    rows = []
    for time_s in range(0, round(minutes * 60), EVERY_S):
        row = {name: round(1e8 + rng.random() * noise) for name, noise in NOISE.items()}
        for name, rise in rise_per_second.items():
            row[name] += round(rise * time_s)
        if 50 <= time_s < 60:
            row["heap"] += 50_000_000
        if time_s > minutes * 30:
            row["resident"] += 20_000_000
        rows.append({"time": float(time_s), **row})
    return rows


def rising(minutes, **rise_per_second):
    return {one.name for one in judgements(samples(minutes, **rise_per_second)) if not one.is_flat}


@pytest.mark.parametrize("minutes", [2, 60])
def test_what_is_flat_but_for_noise_passes(minutes):
    assert rising(minutes) == set()


@pytest.mark.parametrize(
    "minutes, name, per_await",
    [(60, "heap", 20), (60, "blocks", 1 / 40), (60, "resident", 40), (2, "heap", 700), (2, "blocks", 1)],
)
def test_what_grows_with_each_await_is_found(minutes, name, per_await):
    assert rising(minutes, **{name: per_await * AWAITS_HZ}) == {name}


@pytest.mark.parametrize("name", ["threads", "descriptors"])
def test_one_thread_or_descriptor_per_restart_is_found_within_two_minutes(name):
    assert rising(2, **{name: 1 / 10}) == {name}


def test_percentiles_are_right_to_two_percent():
    latencies = Latencies()
    for i in range(1, 10_001):
        latencies.add(i / 1e4)
    for percent in (50, 90, 99):
        assert latencies.percentile(percent) == pytest.approx(percent / 100, rel=0.021)
    assert latencies.summary()["largest"] == 1.0
