"""The benchmark: every section measures what it names, and reports who did not take part."""

import json
import math
from dataclasses import replace

import pytest
from conftest import DOMAIN

from bench import __main__ as bench
from bench import guard, libraries, pictures, report, sizes
from bench.programs.trees import bushy

pytestmark = pytest.mark.ours

long = pytest.mark.long("measures what the bench measures")


@pytest.fixture
def run_of(tmp_path, monkeypatch):
    """Makes a run of tiny sizes, in which these libraries take part."""
    monkeypatch.setattr(bench, "DOMAIN", DOMAIN)

    def make(*found):
        return bench.Run({library.key: library for library in found}, sizes.TINY, tmp_path)

    return make


def stand_in():
    """This project in the place of a sourced ROS 2."""
    return replace(libraries.ours(), key="ros2", title="stand-in")


@pytest.mark.parametrize("section", bench.SECTIONS)
@long
def test_each_section_measures_something_of_every_kind(run_of, section):
    run = run_of(libraries.ours())
    run.measure(section)
    assert run.remarks == []
    assert run.rows
    assert all(math.isfinite(value) for row in run.rows.values() for value in row.values)
    assert not any(row.failed for row in run.rows.values())
    assert report.TITLES[section] in report.page(run.rows, run.libraries, [], [0.0, 0.0], [])


@long
def test_a_sourced_ros_2_is_measured_by_upstreams_names(run_of):
    run = run_of(libraries.ours(), stand_in())
    for section in ("lookups", "growth", "online", "receiving:waits"):
        run.measure(section)
    assert run.remarks == []
    ways = {(row.section, row.way) for row in run.rows.values() if row.who == "ros2"}
    assert ways >= {
        ("lookups", "core"),
        ("growth", "buffer"),
        ("online", "CPU"),
        ("receiving:waits", "blocked"),
    }
    page = report.page(run.rows, run.libraries, [], [0.0, 0.0], [])
    assert "stand-in: answers differ by at most 0 " in page


@long
def test_pictures_are_drawn_of_what_was_measured(run_of, tmp_path):
    pytest.importorskip("matplotlib")
    run = run_of(libraries.ours())
    for section in ("lookups", "growth"):
        run.measure(section)
    drawn = pictures.draw(run.rows, run.libraries, tmp_path, "machine")
    assert [path.name for path in drawn] == ["machine-latency.png", "machine-growth.png"]
    assert all(path.stat().st_size for path in drawn)


def test_a_library_that_fails_is_named_and_the_others_continue(run_of):
    broken = replace(stand_in(), title="broken", python="/bin/false")
    run = run_of(libraries.ours(), broken)
    run.measure("lookups")
    assert {row.who for row in run.rows.values()} == {"ours"}
    assert run.remarks == ["broken left lookups: no message"]


def test_pairs_are_as_many_hops_apart_as_asked():
    tree = bushy("tree", 60, 0.5, 2)

    def links_to_the_root(frame):
        return {frame, *links_to_the_root(tree.parents[frame])} if frame else set()

    for target, source in tree.pairs(4, 20):
        between = links_to_the_root(target) ^ links_to_the_root(source)
        assert len(between) == 4
        assert any(tree.dynamic[link] for link in between)


def test_results_name_no_place_of_this_machine():
    text = bench.redacted(f"{libraries.ROOT}/x failed; see https://host.example/simple/")
    assert text == ".../x failed; see (an address)"


def test_the_guard_fails_on_what_became_slower():
    found = [
        guard.verdict(ratio, before, 0.1) for ratio, before in ((1.2, 1), (1.05, 1), (0.8, 1), (1, None))
    ]
    assert found == ["slower", "as before", "faster", "no baseline"]


def test_the_guards_baseline_knows_every_case():
    assert [guard.REFERENCE, *json.loads(guard.BASELINE.read_text())["ratios"]] == list(guard.CASES)


def test_without_valgrind_the_guard_says_that_it_is_skipped(monkeypatch, capsys):
    monkeypatch.setenv("PATH", "")
    assert guard.main([]) == 0
    assert "skipped" in capsys.readouterr().out
