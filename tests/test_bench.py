"""The benchmark: every section runs and reports what it measured."""

import json
import math
import sys
from dataclasses import replace

import numpy as np
import pytest
from conftest import DOMAIN
from numpy.testing import assert_allclose
from random_messages import numbers

from bench import __main__, guard, lookups, peers, pictures, race, report, shared, sizes, targets, trees
from bench.nodes import OUR_PATHS, WAKING
from bench.processes import CONTESTANTS, Failure, Library, Process, run_command
from bench.race import Entry, Row, Rows, Run, Sample, largest_deviation

pytestmark = pytest.mark.ours

SECTIONS = {name: section for name, section in __main__.SECTIONS.items() if name != "instructions"}


def run_of(libraries, folder, measured=sizes.TINY):
    return Run({library.key: library for library in libraries}, measured, folder, lambda text: None)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """All tests share it: its rows are those of all sections measured before."""
    with run_of([peers.ours()], tmp_path_factory.mktemp("bench")) as run:
        yield run


@pytest.fixture
def measured(run, monkeypatch):
    """A function: the rows of a section, which is measured once."""
    monkeypatch.setattr(race, "domain", lambda: DOMAIN)

    def rows_of(section):
        if all(row.section != section for row in run.rows):
            SECTIONS[section](run)
        return [row for row in run.rows if row.section == section]

    return rows_of


@pytest.mark.parametrize("section", SECTIONS)
def test_each_section_measures_something_of_every_kind(run, measured, section):
    rows = measured(section)
    assert rows
    assert not run.absent
    assert all(math.isfinite(row.median) and row.failed == 0 for row in rows)
    assert all(row.p05 <= row.p25 <= row.median <= row.p75 <= row.p95 for row in rows)


def test_receiving_is_measured_in_every_way(measured):
    rows = measured("receive")
    assert all(row.median > 0 for row in rows)
    # The executor's receiver thread serves static transforms alone, and may not run in this time.
    assert {row.way for row in rows} - {"executor, its thread"} == {
        *OUR_PATHS,
        *(f"{path}, its thread" for path in OUR_PATHS if path != "executor"),
        *(f"{path}, {how}" for path in WAKING for how in ("block", "poll")),
    }


def test_shared_buffers_are_measured_beside_private_ones(measured):
    rows = measured("shared")
    compared = [[row.labels for row in rows if row.way == way] for way in ("private", "attached")]
    private, attached = ([labels for labels in own if "nodes" not in labels] for own in compared)
    assert private == attached
    assert len(private) == 3 + 4 + 3  # calls while the owner rests and while it inserts, kinds of memory
    assert all(row.deviation < 1e-12 for row in rows if row.deviation is not None)
    nodes = {(row.way, row.labels["nodes"]) for row in rows if "nodes" in row.labels}
    assert {("listening", 1), ("listening", 2), ("attached", 2), ("idle", 2)} <= nodes
    # An idle node may well sleep all the time.
    assert all(row.median > 0 for row in rows if "nodes" in row.labels and row.way != "idle")


def test_idle_nodes_are_left_out_of_both_sides():
    labels = {"nodes": 4}
    one, together, idle = (
        Row("shared", "ours", way, own, value, 0, 0, 0, 0, [value], "CPU")
        for way, own, value in (
            ("listening", {"nodes": 1}, 0.04),
            ("attached", labels, 0.08),
            ("idle", labels, 0.02),
        )
    )
    ratios = shared.nodes_ratios(Rows([one, together, idle]))
    assert ratios == {"all": 2.0, "less idle nodes": pytest.approx(0.06 / 0.035)}
    assert all(math.isnan(ratio) for ratio in shared.nodes_ratios(Rows([one, idle])).values())


def test_every_type_is_measured_beside_numpy(measured):
    who_of = {}
    for row in measured("types"):
        who_of.setdefault(row.labels["type"], set()).add(row.who)
    assert len(who_of) == 5 + 6 + 2  # messages, clouds, arrays
    assert all({"ours", "numpy"} <= who for who in who_of.values())


def test_what_reads_recordings_finds_the_same_transforms(measured):
    rows = [row for row in measured("recordings") if row.deviation is not None]
    assert {row.way for row in rows} == {"lookup_transform", "rosbags + lists", "mcap-ros2-support + lists"}
    assert all(row.deviation < 1e-9 for row in rows)


def test_tables_and_verdicts_are_written_of_what_was_measured(run, measured):
    assert all(measured(section) for section in SECTIONS)
    tables = report.tables(run.rows, run.libraries)
    assert all(report.SECTIONS[section][0] in tables for section in SECTIONS)
    kinds = {row.labels["waiting_for"] for row in measured("waiters")} | {
        row.way for row in measured("waiters")
    }
    assert len(kinds) == 9 + 6  # of waiters, of inserts
    assert all(kind in tables for kind in kinds)
    verdicts = targets.verdicts(run.rows)
    assert all(verdict.what in report.verdict_table(verdicts) for verdict in verdicts)
    # Nobody to compare with is no pass.
    unknown = {verdict.target for verdict in verdicts if verdict.verdict == targets.UNKNOWN}
    assert unknown == {
        "lookup-vs-debian-python",
        "lookup-vs-jazzy-python",
        "past-lookup-vs-cpp",
        "latest-lookup-vs-cpp",
        "lookup-vs-schiebung",
        "past-vector-vs-cpp",
        "latest-vector-vs-cpp",
        "vector-time",
        "vector-threads",
        "insert-vs-python",
        "spin-once",
        "types-vs-python",
        "recording-workers",
    }
    assert {verdict.target for verdict in verdicts} - unknown == {
        "growth-with-samples",
        "growth-with-frames",
        "growth-with-ancestors",
        "insert-serialised",
        "insert-beside-futures",
        "insert-beside-waiters",
        "failing-lookup",
        "memory-per-sample",
        "load-lost",
        "load-insert",
        "load-sleep",
        "load-lookup",
        "receive-vs-python",
        "receive-vs-floor",
        "shared-lookup",
        "shared-vector",
        "shared-wait",
        "shared-memory",
        "shared-attach",
        "shared-nodes",
        "watch-vs-listener",
        "recording-load",
        "recording-pickle",
        "wake-up latency",
    }
    json.dumps(run.rows.as_json())


def test_pictures_are_drawn_of_what_was_measured(run, measured, tmp_path):
    pytest.importorskip("matplotlib")
    assert all(measured(section) for section in ("lookups", "online", "growth"))
    drawn = pictures.draw(run.rows, run.libraries, tmp_path, "machine")
    assert [path.name for path in drawn] == ["machine-latency.png", "machine-growth.png"]
    assert all(path.stat().st_size for path in drawn)


def test_a_sourced_ros_2_is_measured_through_upstreams_names_only(tmp_path):
    ours = peers.ours()
    program = [sys.executable, str(CONTESTANTS / "ros2_tf2.py")]
    stand_in = Library("ros2", "stand-in", program, ("buffer", "core"), ours.environment)
    with run_of([ours, stand_in], tmp_path, replace(sizes.TINY, depths=(10,))) as run:
        run.ask("ros2", "about")
        lookups.lookups(run)
    assert not run.absent
    assert {row.who for row in run.rows} == {"ours", "ros2"}
    assert {row.deviation for row in run.rows} == {0.0}


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


def test_a_section_can_be_measured_alone(monkeypatch, capsys):
    monkeypatch.setattr(__main__, "FULL", sizes.TINY)
    assert __main__.main(["--only", "failing"]) == 0
    printed = capsys.readouterr().out
    assert report.SECTIONS["failing"][0] in printed
    assert report.SECTIONS["lookups"][0] not in printed
    assert "wrote" not in printed
    assert targets.UNKNOWN not in printed


def test_an_order_that_takes_too_long_is_given_up():
    process = Process(Library("slow", "slow", [sys.executable, "-c", "import time; time.sleep(60)"], ()))
    try:
        with pytest.raises(Failure, match="no answer to about"):
            process.ask("about", seconds=0.1)
    finally:
        process.end()


def test_a_command_that_fails_says_why():
    assert run_command(sys.executable, "-c", "print('printed')") == "printed\n"
    with pytest.raises(Failure, match="ended with 1: no such library"):
        run_command(sys.executable, "-c", "raise SystemExit('no such library')")
    with pytest.raises(Failure, match="took longer"):
        run_command(sys.executable, "-c", "import time; time.sleep(60)", seconds=0.1)


@pytest.fixture
def types_by_numpy(monkeypatch):
    monkeypatch.syspath_prepend(CONTESTANTS)
    import types_by_numpy

    return types_by_numpy


def test_numpy_computes_the_same_messages(types_by_numpy):
    t = types_by_numpy.transform()
    for message, ours, by_numpy in types_by_numpy.messages().values():
        assert_allclose(numbers(ours(message, t)), numbers(by_numpy(message, t)), rtol=1e-12)


def test_numpy_computes_the_same_clouds(types_by_numpy):
    t = types_by_numpy.transform()
    for step, kind in types_by_numpy.CLOUDS.values():
        cloud = types_by_numpy.cloud(step, kind, 50)
        x, y = (
            np.ndarray((50, 3), kind, data, 0, (step, int(kind[1])))
            for data in (
                types_by_numpy.do_transform_cloud(cloud, t).data,
                types_by_numpy.cloud_by_numpy(cloud, t),
            )
        )
        assert_allclose(x, y, rtol=2e-7 if kind == "f4" else 1e-12, atol=1e-5 if kind == "f4" else 1e-12)


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
