"""The benchmark of listening: every part of it runs, and says what it saw."""

import math

import pytest
from conftest import DOMAIN

from bench import online, receive

pytestmark = pytest.mark.ours


def test_every_road_is_measured_and_the_targets_are_told(monkeypatch):
    monkeypatch.setattr(online, "domain", lambda: DOMAIN)
    rows = receive.measure(receive.Plan(rounds=1, filling=20, seconds=0.2, wakes=5))
    assert all(math.isfinite(row["median"]) and row["median"] > 0 for row in rows)
    ways = {row["way"] for row in rows if row["who"] == "ours"}
    # That of the static transforms looks up once a second, and so at times in this one.
    ways.discard("executor, its thread")
    assert ways == {
        *receive.ROADS,
        *(f"{road}, its thread" for road in receive.ROADS if road != "executor"),
        *(f"{road}, {how}" for road in ("listener", "executor") for how in ("block", "poll")),
    }
    table = receive.table(rows)
    assert all(title in table for title in receive.ROADS.values())
    assert table.count("wanted") == 6
