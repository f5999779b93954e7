"""The benchmark: every part of it runs, and says what it saw."""

import json
import math
import sys
from dataclasses import replace

import pytest
from conftest import DOMAIN

from bench import (
    __main__,
    failing,
    growth,
    guard,
    inserts,
    load,
    lookups,
    memory,
    online,
    peers,
    pictures,
    report,
    sizes,
    targets,
    trees,
    vectors,
    waiters,
)
from bench.arena import Arena, largest_deviation
from bench.processes import CONTESTANTS, Failure, Library, Process
from bench.rows import Row, Rows, percentile

pytestmark = pytest.mark.ours

SECTIONS = {
    module.SECTION: module
    for module in (lookups, growth, vectors, inserts, waiters, failing, memory, online, load)
}


@pytest.fixture(scope="module")
def arena(tmp_path_factory):
    """The sections share it: its rows are what all of them have measured so far."""
    folder = tmp_path_factory.mktemp("bench")
    with Arena([peers.ours()], sizes.TINY, folder, lambda text: None) as arena:
        yield arena


@pytest.mark.parametrize("section", SECTIONS)
def test_each_section_measures_something_of_every_kind(arena, monkeypatch, section):
    monkeypatch.setattr(online, "domain", lambda: DOMAIN)
    SECTIONS[section].run(arena)
    rows = [row for row in arena.rows if row.section == section]
    assert rows
    assert not arena.absent
    assert all(math.isfinite(row.median) and row.failed == 0 for row in rows)
    assert all(row.p05 <= row.p25 <= row.median <= row.p75 <= row.p95 for row in rows)


def test_tables_and_verdicts_are_written_of_what_was_measured(arena):
    tables = report.tables(arena.rows, arena.libraries)
    assert all(report.SECTION_TITLES[section] in tables for section in set(SECTIONS) - {"waiters"})
    assert all(kind in waiters.table(arena.rows) for kind in waiters.KINDS)
    verdicts = targets.verdicts(arena.rows)
    assert {verdict.target for verdict in verdicts} == {1, 2, 3, 4, 8, 9, 10}
    assert all(verdict.what in report.verdict_table(verdicts) for verdict in verdicts)
    # Nobody to compare with is no pass.
    assert {verdict.verdict for verdict in verdicts if verdict.target == 1} == {targets.UNKNOWN}
    json.dumps(arena.rows.as_json())


def test_pictures_are_drawn_of_what_was_measured(arena, tmp_path):
    pytest.importorskip("matplotlib")
    drawn = pictures.draw(arena.rows, arena.libraries, tmp_path, "machine")
    assert [path.name for path in drawn] == ["machine-latency.png", "machine-growth.png"]
    assert all(path.stat().st_size for path in drawn)


def test_a_sourced_ros_2_is_asked_by_upstreams_names_only(tmp_path):
    ours = peers.ours()
    program = [sys.executable, str(CONTESTANTS / "ros2_tf2.py")]
    stand_in = Library("ros2", "stand-in", program, ("buffer", "core"), ours.environment)
    with Arena([ours, stand_in], replace(sizes.TINY, depths=(10,)), tmp_path, lambda text: None) as arena:
        arena.ask("ros2", "about")
        lookups.run(arena)
    assert not arena.absent
    assert {row.who for row in arena.rows} == {"ours", "ros2"}
    assert {row.deviation for row in arena.rows} == {0.0}


def test_a_library_that_fails_is_named_and_the_others_go_on(tmp_path):
    broken = Library(
        "broken", "broken", [sys.executable, "-c", "raise SystemExit('no such library')"], ("core",)
    )
    with Arena([broken], sizes.TINY, tmp_path, lambda text: None) as arena:
        lookups.run(arena)
    assert arena.rows == []
    assert {entry["who"] for entry in arena.absent} == {"broken"}
    assert all("no such library" in entry["reason"] for entry in arena.absent)


def test_a_section_can_be_measured_alone(monkeypatch, capsys):
    monkeypatch.setattr(__main__, "FULL", sizes.TINY)
    assert __main__.main(["--only", "failing"]) == 0
    printed = capsys.readouterr().out
    assert report.SECTION_TITLES["failing"] in printed
    assert report.SECTION_TITLES["lookups"] not in printed
    assert "wrote" not in printed
    assert targets.UNKNOWN not in printed


def test_an_order_that_takes_too_long_is_given_up():
    process = Process(Library("slow", "slow", [sys.executable, "-c", "import time; time.sleep(60)"], ()))
    try:
        with pytest.raises(Failure, match="no answer to about"):
            process.ask("about", seconds=0.1)
    finally:
        process.kill()


def test_pairs_are_as_many_hops_apart_as_asked_and_move():
    tree = trees.bushy("tree", 60, 0.5, 2)
    for target, source in tree.pairs(4, 20, seed=1, must_move=True):
        up = {target: 0}
        frame = target
        while frame:
            up[tree.parents[frame]] = up[frame] + 1
            frame = tree.parents[frame]
        steps, frame, links = 0, source, []
        while frame not in up:
            links.append(frame)
            frame = tree.parents[frame]
            steps += 1
        top, frame = frame, target
        while frame != top:
            links.append(frame)
            frame = tree.parents[frame]
        assert steps + up[top] == 4
        assert any(tree.dynamic[link] for link in links)


def test_percentiles_lie_between_the_ranks():
    assert percentile([1.0, 2.0, 3.0], 0.5) == 2.0
    assert percentile([0.0, 10.0], 0.05) == pytest.approx(0.5)


def test_a_quaternion_and_its_negative_are_one_answer():
    identity = [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0]
    assert largest_deviation([identity], [[1.0, 2.0, 3.5, 0.0, 0.0, 0.0, -1.0]]) == 0.5
    assert largest_deviation([None], [identity]) is None


def test_results_name_no_place_of_this_machine():
    text = __main__.redacted(f"{peers.ROOT}/x failed; see https://host.example/simple/ and {sys.prefix}/bin")
    assert str(peers.ROOT) not in text
    assert sys.prefix not in text
    assert "example" not in text


def verdict_on(ratio, other=1.0):
    row = Row(
        "growth", "ours", "buffer", {"axis": "samples", "value": 10, "pairs": "few"}, other, 0, 0, 0, 0, []
    )
    grown = replace(row, labels={**row.labels, "value": 20}, median=ratio)
    rows = Rows([row, grown])
    return next(verdict.verdict for verdict in targets.verdicts(rows) if "10 to 20 samples" in verdict.what)


def test_a_target_is_passed_at_its_limit_and_not_beyond():
    assert verdict_on(1.5) == targets.PASS
    assert verdict_on(1.51) == targets.SHORT


def test_the_guard_fails_on_what_became_slower():
    baseline = {"python": guard.python_series(), "ratios": {"a": 1.0, "b": 1.0, "c": 1.0}}
    verdicts = dict(guard.compare({"a": 1.2, "b": 1.05, "c": 0.8, "d": 1.0}, baseline, 0.1))
    assert verdicts == {"a": "slower", "b": "as before", "c": "faster", "d": "no baseline"}


def test_the_guards_baseline_knows_every_case():
    assert set(json.loads(guard.BASELINE.read_text())["ratios"]) == set(guard.CASES)


def test_without_valgrind_the_guard_says_that_it_is_skipped(monkeypatch, capsys):
    monkeypatch.setenv("PATH", "")
    assert guard.main([]) == 0
    assert "skipped" in capsys.readouterr().out
