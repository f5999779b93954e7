"""The benchmark: every section runs and reports what it measured."""

import json
import math
import sys
from dataclasses import replace

import pytest
from conftest import DOMAIN

from bench import (
    __main__,
    guard,
    lookups,
    nodes,
    peers,
    pictures,
    race,
    receiving,
    report,
    sizes,
    trees,
)
from bench.processes import CONTESTANTS, Failure, Library
from bench.race import Entry, Run, Sample

pytestmark = pytest.mark.ours

long = pytest.mark.long("measures what the bench measures")

SECTIONS = __main__.SECTIONS


def run_of(libraries, folder, measured=sizes.TINY):
    return Run({library.key: library for library in libraries}, measured, folder, lambda text: None)


def section_of(name):
    """The section of which this is a part."""
    return name.partition(":")[0]


def stand_in():
    """This project in the place of a sourced ROS 2."""
    program = [sys.executable, str(CONTESTANTS / "ros2_tf2.py")]
    return Library("ros2", "stand-in", program, ("buffer", "core"), peers.ours().environment)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """All tests share it: its rows are those of all sections measured before."""
    with run_of([peers.ours()], tmp_path_factory.mktemp("bench")) as run:
        run.measured = set()
        yield run


@pytest.fixture
def measured(run, monkeypatch):
    """A function: the rows of a section, which is measured once."""
    monkeypatch.setattr(race, "domain", lambda: DOMAIN)

    def rows_of(section):
        for name in SECTIONS:
            if section in (name, section_of(name)) and name not in run.measured:
                run.absent.clear()
                SECTIONS[name](run)
                assert not run.absent
                run.measured.add(name)
        return [row for row in run.rows if row.section == section_of(section)]

    return rows_of


@pytest.mark.parametrize("section", SECTIONS)
@long
def test_each_section_measures_something_of_every_kind(measured, section):
    rows = measured(section)
    assert rows
    assert all(math.isfinite(row.median) and row.failed == 0 for row in rows)
    assert all(row.p05 <= row.p25 <= row.median <= row.p75 <= row.p95 for row in rows)


@long
def test_pictures_are_drawn_of_what_was_measured(run, measured, tmp_path):
    pytest.importorskip("matplotlib")
    assert all(measured(section) for section in ("lookups", "online", "growth"))
    drawn = pictures.draw(run.rows, run.libraries, tmp_path, "machine")
    assert [path.name for path in drawn] == ["machine-latency.png", "machine-growth.png"]
    assert all(path.stat().st_size for path in drawn)


@long
def test_a_sourced_ros_2_is_measured_through_upstreams_names_only(tmp_path):
    with run_of([peers.ours(), stand_in()], tmp_path, replace(sizes.TINY, depths=(10,))) as run:
        run.ask("ros2", "about")
        lookups.lookups(run)
    assert not run.absent
    assert {row.who for row in run.rows} == {"ours", "ros2"}
    assert {row.deviation for row in run.rows} == {0.0}


@long
def test_a_sourced_ros_2_receives_beside_ours(tmp_path, monkeypatch):
    monkeypatch.setattr(race, "domain", lambda: DOMAIN)
    with run_of([peers.ours(), stand_in()], tmp_path) as run:
        receiving.waits(run)
        nodes.online(run)
    assert not run.absent
    theirs = {(row.section, row.way) for row in run.rows if row.who == "ros2"}
    assert theirs == {
        ("receiving", "wait, block"),
        ("receiving", "wait, own insert"),
        *(("online", way) for way in ("CPU", "buffer", "buffer, p99")),
    }


def test_a_library_that_fails_is_named_and_the_others_continue(tmp_path):
    command = [sys.executable, "-c", "raise SystemExit('no such library')"]
    broken = Library("broken", "broken", command, ("core",))
    with run_of([peers.ours(), broken], tmp_path, replace(sizes.TINY, depths=(10,))) as run:
        lookups.lookups(run)
    assert {row.who for row in run.rows} == {"ours"}
    assert {entry["who"] for entry in run.absent} == {"broken"}
    assert all("no such library" in entry["reason"] for entry in run.absent)


def test_an_entry_that_fails_once_has_no_row(tmp_path):
    turns = []

    def measure(who):
        turns.append(who)
        if turns.count("broken") == 2 and who == "broken":
            raise Failure("it broke")
        return [Sample(who, "way", {}, [1.0])]

    with run_of([], tmp_path) as run:
        run.race("section", [Entry(who, lambda who=who: measure(who)) for who in ("broken", "whole")], 3)
    assert [(row.who, row.rounds) for row in run.rows] == [("whole", [1.0, 1.0, 1.0])]
    assert run.absent == [{"who": "broken", "what": "section", "reason": "it broke"}]
    assert turns == ["broken", "whole", "whole", "broken", "whole"]


@long
def test_a_section_can_be_measured_alone(monkeypatch, capsys):
    monkeypatch.setattr(__main__, "FULL", sizes.TINY)
    assert __main__.main(["--only", "vectors", "receiving:lookups"]) == 0
    printed = capsys.readouterr().out
    assert report.SECTIONS["vectors"][0] in printed
    assert receiving.LOOKUP in printed
    assert receiving.OWN_INSERT not in printed
    assert report.SECTIONS["lookups"][0] not in printed
    assert "wrote" not in printed


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


def test_results_name_no_place_of_this_machine():
    text = __main__.redacted(f"{peers.ROOT}/x failed; see https://host.example/simple/ and {sys.prefix}/bin")
    assert str(peers.ROOT) not in text
    assert sys.prefix not in text
    assert "example" not in text


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
