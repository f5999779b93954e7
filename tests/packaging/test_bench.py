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
    shared,
    sizes,
    targets,
    trees,
)
from bench.processes import CONTESTANTS, Failure, Library, Process, run_command
from bench.race import Entry, Row, Rows, Run, Sample, largest_deviation

pytestmark = pytest.mark.ours

long = pytest.mark.long("measures what the bench measures")

SECTIONS = {name: section for name, section in __main__.SECTIONS.items() if name != "instructions"}


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
def test_receiving_is_measured_in_every_way(measured):
    rows = measured("receiving")
    assert {row.way for row in rows} == {
        "listener",
        "executor",
        "floor",
        *(f"wait, {how}" for how in ("block", "poll", "own insert")),
        "lookup, 100 Hz",
        "lookup, 100 Hz, p99",
        "messages lost",
        "messages sent",
        "spin_once",
        "executor.spin_once",
    }
    assert all(row.median > 0 for row in rows if row.way != "messages lost")
    loads = [
        {(row.labels["transforms"], row.labels["listeners"]) for row in rows if row.way == way}
        for way in ("listener", "floor")
    ]
    assert loads[0] == loads[1] == {(1, 1), (50, 1), (1, 3), (50, 3)}
    lost = {row.labels["beside"]: row for row in rows if row.way == "messages lost"}
    assert lost.keys() == receiving.FLOODS.keys()
    # Far fewer than the queues hold.
    assert all(row.rounds == [0.0] for row in lost.values())


@long
def test_subscriptions_that_nobody_takes_from_let_the_executor_sleep(measured):
    """Otherwise its wait returns at once, again and again: milliseconds for each message."""
    floors = [row for row in measured("receiving") if row.way == "floor"]
    assert all(row.median < 1e6 for row in floors)


def test_listeners_are_compared_with_what_their_subscriptions_and_inserts_may_cost():
    def row(way, transforms, listeners, ns):
        labels = {"transforms": transforms, "Hz": 1, "listeners": listeners}
        return Row("receiving", "ours", way, labels, ns, 0, 0, 0, 0, [ns])

    def measured(ns):
        allowed = {(1, 1): 25_200, (50, 1): 60_000, (1, 3): 25_600, (50, 3): 130_000}
        floors = {(1, 1): 20_000, (50, 1): 40_000, (1, 3): 20_000, (50, 3): 80_000}
        rows = [row("floor", *load, floor) for load, floor in floors.items()]
        rows += [row("listener", *load, allowed[load]) for load in allowed if load != (50, 3)]
        verdicts = targets.verdicts(Rows([*rows, row("listener", 50, 3, ns)]))
        return next(verdict for verdict in verdicts if verdict.target == "receive-vs-floor")

    assert measured(130_000).verdict == targets.PASS
    assert measured(131_000).verdict == targets.SHORT
    assert measured(131_000).measured == "1.01x, worst: 50 transforms, 3 listeners"


def test_one_lost_message_fails():
    labels = {"Hz": 2000, "queue": 2000, "beside": "no reader"}
    row = Row("receiving", "ours", "messages lost", labels, 0, 0, 0, 0, 0, [0, 0, 1], "messages")
    verdicts = {verdict.target: verdict for verdict in targets.verdicts(Rows([row]))}
    assert verdicts["receive-lost"].verdict == targets.SHORT


@long
def test_shared_buffers_are_measured_beside_private_ones(measured):
    rows = measured("shared")
    compared = [[row.labels for row in rows if row.way == way] for way in ("private", "attached")]
    private, attached = ([labels for labels in own if "nodes" not in labels] for own in compared)
    assert private == attached
    assert len(private) == 3 + 4 + 3  # calls while the owner rests and while it inserts, kinds of memory
    assert all(row.deviation < 1e-12 for row in rows if row.deviation is not None)
    nodes = {(row.way, row.labels["nodes"]) for row in rows if "nodes" in row.labels}
    assert {("listening", 1), ("listening", 2), ("attached", 2), ("looking", 2), ("idle", 2)} <= nodes
    # An idle node may well sleep all the time.
    assert all(row.median > 0 for row in rows if "nodes" in row.labels and row.way != "idle")


def test_attached_nodes_are_compared_with_one_that_listens_and_idle_ones():
    labels = {"nodes": 4}
    one, together, idle = (
        Row("shared", "ours", way, own, value, 0, 0, 0, 0, [value], "CPU")
        for way, own, value in (
            ("listening", {"nodes": 1}, 0.04),
            ("attached", labels, 0.08),
            ("idle", labels, 0.02),
        )
    )
    assert shared.nodes_ratio(Rows([one, together, idle])) == pytest.approx(0.08 / 0.06)
    assert math.isnan(shared.nodes_ratio(Rows([one, idle])))


def test_what_looking_costs_an_attached_node_is_the_difference_from_one_that_does_not():
    labels = {"nodes": 4}
    resting, looking = (
        Row("shared", "ours", way, labels, value, 0, 0, 0, 0, [value], "CPU")
        for way, value in (("attached", 0.08), ("looking", 0.12))
    )
    # 4 nodes, 50 transforms 200 times a second.
    assert shared.looking_us(Rows([resting, looking])) == pytest.approx(1)
    assert math.isnan(shared.looking_us(Rows([resting])))


@long
def test_tables_and_verdicts_are_written_of_what_was_measured(run, measured):
    assert all(measured(section) for section in SECTIONS)
    tables = report.tables(run.rows, run.libraries)
    assert all(report.SECTIONS[section_of(name)][0] in tables for name in SECTIONS)
    verdicts = targets.verdicts(run.rows)
    assert all(verdict.what in report.verdict_table(verdicts) for verdict in verdicts)
    # Nobody to compare with is no pass.
    unknown = {verdict.target for verdict in verdicts if verdict.verdict == targets.UNKNOWN}
    assert unknown == {
        "lookup-vs-python",
        "past-lookup-vs-cpp",
        "latest-lookup-vs-cpp",
        "past-vector-vs-cpp",
        "latest-vector-vs-cpp",
        "vector-time",
        "vector-threads",
        "insert-vs-python",
        "online-lookup",
        "spin-once",
        "receive-vs-python",
        "recording-workers",
    }
    assert {verdict.target for verdict in verdicts} - unknown == {
        "growth-with-samples",
        "growth-with-frames",
        "growth-with-ancestors",
        "insert-serialised",
        "insert-beside-futures",
        "memory-per-sample",
        "receive-vs-floor",
        "receive-lost",
        "lookup-beside-messages",
        "shared-lookup",
        "shared-vector",
        "shared-wait",
        "shared-memory",
        "shared-attach",
        "shared-looking",
        "shared-nodes",
        "recording-load",
        "recording-pickle",
        "wake-up latency",
    }
    json.dumps(run.rows.as_json())


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
    known = {verdict.target: verdict.verdict for verdict in targets.verdicts(run.rows)}
    assert known["online-lookup"] != targets.UNKNOWN


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
