# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Many recordings: what is done, what is skipped, and that it is the same wherever it is done."""

import json
import os
import signal
import subprocess
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from making_bags import S, Sent, Tf, drive, scan, write_folder, write_mcap, write_split
from processes import killed, start
from waiting import DEADLINE_S, until

bag = pytest.importorskip("tf2_ros_tools.bag")
dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")
parquet = pytest.importorskip("pyarrow.parquet")
pyarrow_csv = pytest.importorskip("pyarrow.csv")
psutil = pytest.importorskip("psutil")

from dying_worker import Deadly  # noqa: E402

from tf2_ros import InvalidArgumentException  # noqa: E402
from tf2_ros_tools.recordings.map_recordings import KEY, find_recordings, local_workers, table_of  # noqa: E402

pytestmark = pytest.mark.long("needs Dask")


@pytest.fixture
def runs(tmp_path):
    """A folder with four good recordings, two of them with the same name."""
    at = tmp_path / "runs"
    for day in ("monday", "tuesday"):
        (at / day).mkdir(parents=True)
        write_mcap(at / day / "run.mcap", drive(40))
    write_folder(at / "monday" / "folder", drive(30), "sqlite3")
    write_split(at / "split", drive(30))
    return at


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out"


def mapped(runs, out, **options):
    options = {"workers": 1, **options} if "scheduler" not in options else options
    return bag.map_recordings(runs, "map", "camera", out, **options)


def tables(out):
    """What a folder holds: of each table the columns, and what it says that it was made of, but for times."""
    return {path.name: contents(path) for path in out.glob("[!_.]*.parquet")}


def contents(path):
    table = parquet.read_table(path)
    made_of = json.loads(table.schema.metadata[KEY])
    for row in made_of["found"]:
        row.pop("seconds", None)
    return table.to_pydict(), made_of


def findings(result):
    rows = pyarrow_csv.read_csv(result.findings).to_pylist()
    return [{name: value for name, value in row.items() if name != "seconds"} for row in rows]


# What comes out.


def test_each_recording_becomes_a_table_and_one_table_has_the_findings(runs, out):
    result = mapped(runs, out)
    assert len(result.done) == 4 and not result.skipped and not result.failed
    assert set(result.done) == set(find_recordings(runs))
    run = str(runs / "monday" / "run.mcap")
    columns, _ = contents(out / os.path.basename(result.done[run]))
    assert list(columns) == ["file", "stamp_ns", "x", "y", "z", "qx", "qy", "qz", "qw", "valid", "gap"]
    assert set(columns["file"]) == {run} and all(columns["valid"])
    assert len(columns["stamp_ns"]) == 40
    places, rotations = bag.load(run).lookup_transforms("map", "camera", columns["stamp_ns"])
    poses = [columns[name] for name in ("x", "y", "z", "qx", "qy", "qz", "qw")]
    np.testing.assert_equal(np.transpose(poses), np.hstack([places, rotations]))
    [row] = [row for row in findings(result) if row["file"] == run]
    assert (row["kind"], row["transforms"], row["rows"], row["valid"]) == ("summary", 82, 40, 40)
    assert row["span_s"] == pytest.approx(4.0)
    assert row["text"] == "82 transforms in 4.0 s, answers at 40 of 40 times"
    shown = f"<tf2_ros_tools.bag.MappedRecordings: 4 done, 0 skipped, 0 failed, in {str(out)!r}>"
    assert repr(result) == shown
    assert parquet.read_table(out).num_rows == 40 + 40 + 30 + 30  # and the findings are none of them


def test_times_without_an_answer_are_a_finding(tmp_path, out):
    scans = [scan(101 * S, 101 * S), scan(102 * S, 900 * S)]
    write_mcap(tmp_path / "run.mcap", sorted([*drive(40), *scans], key=lambda one: one.log_ns))
    result = mapped(tmp_path / "run.mcap", out, at="/scan")
    [(columns, _)] = tables(out).values()
    assert columns["valid"] == [True, False]
    lacks = [row["text"] for row in findings(result) if row["kind"] == "lookup"]
    assert lacks == ["no answer at 1 of 2 times"]


def test_a_recording_without_the_frames_has_an_empty_table_and_a_finding(runs, out):
    write_mcap(runs / "other.mcap", [Sent(1, "/tf", [Tf("a", "b", 1)])])
    result = mapped(runs, out)
    assert not result.failed
    columns, _ = contents(out / os.path.basename(result.done[str(runs / "other.mcap")]))
    assert columns["stamp_ns"] == []
    [row] = [row for row in findings(result) if row["kind"] == "lookup"]
    assert row["file"] == str(runs / "other.mcap") and '"map"' in row["text"]
    assert parquet.read_table(out).num_rows == 140


# Whatever is wrong with one recording stops none of the others.


def test_a_recording_that_cannot_be_read_is_reported_and_stops_nobody(runs, out):
    spoiled, deleted = (str(runs / day / "run.mcap") for day in ("monday", "tuesday"))
    done = mapped(runs, out).done
    os.truncate(spoiled, os.path.getsize(spoiled) // 2)
    os.unlink(deleted)
    (runs / "broken.mcap").write_bytes(b"broken")
    write_mcap(runs / "more.mcap", drive(40))
    result = mapped([runs, deleted], out)
    assert (len(result.done), len(result.skipped)) == (1, 2)
    assert set(result.failed) == {spoiled, deleted, str(runs / "broken.mcap")}
    assert result.failed[deleted] == f"{deleted}: No such file or directory"
    errors = {row["file"]: row["text"] for row in findings(result) if row["kind"] == "error"}
    assert errors == result.failed and "run.mcap is broken" in errors[spoiled]
    # The table of a spoiled recording goes, that of a deleted one stays.
    assert [os.path.exists(done[one]) for one in (spoiled, deleted)] == [False, True]


# Restarting.


def test_names_cannot_steer_the_terminal_that_shows_the_findings(tmp_path, out):
    hostile = "x\x1b[2J\x7f\u202e\nok"
    escaped = r"x\x1b[2J\x7f\u202e\nok"
    frames = [Tf("map", "camera", 0), Tf(hostile, "boat", 0), Tf("map", hostile + "2", 0, (np.nan, 0, 0))]
    write_mcap(tmp_path / "good.mcap", [Sent(S, "/tf_static", frames)])
    (tmp_path / f"{hostile}.mcap").write_bytes(b"no recording")
    result = mapped(tmp_path, out)
    with open(result.findings, newline="") as file:
        lines = file.read().split("\r\n")
    assert [line for line in lines if not line.isprintable()] == []
    assert {row["kind"] for row in findings(result)} == {"summary", "roots", "refused", "error"}
    roots, refused, error = (
        next(row for row in findings(result) if row["kind"] == kind) for kind in ("roots", "refused", "error")
    )
    assert roots["text"] == f"2 unconnected trees: map (2 frames), {escaped} (2 frames)"
    assert refused["frame"] == f"{escaped}2" and f"of {escaped}2 by /tf_static is refused" in refused["text"]
    assert error["file"] == str(tmp_path / f"{escaped}.mcap") and f"{escaped}.mcap" in error["text"]


def state(out):
    return {path.name: path.stat().st_mtime_ns for path in out.glob("[!_]*.parquet")}


def test_a_restart_skips_what_is_done_and_knows_what_was_found(runs, out):
    first = mapped(runs, out)
    before, found = state(out), findings(first)
    os.unlink(first.findings)
    os.unlink(first.done[str(runs / "split")])
    del before[os.path.basename(first.done[str(runs / "split")])]
    second = mapped(runs, out)
    assert set(second.done) == {str(runs / "split")} and len(second.skipped) == 3
    assert {name: time for name, time in state(out).items() if name in before} == before
    assert findings(second) == found
    third = mapped(runs, out)
    assert not third.done and third.skipped == first.done and findings(third) == found


@pytest.mark.parametrize("kept", [0, 100, -1])
def test_a_table_that_was_cut_off_is_written_again(kept, tmp_path, out):
    path = write_mcap(tmp_path / "run.mcap", drive(40))
    [table] = map(Path, mapped(path, out).done.values())
    whole, wanted = table.read_bytes(), parquet.read_table(table)
    table.write_bytes(whole[:kept])
    assert mapped(path, out).done and parquet.read_table(table).equals(wanted)


@pytest.mark.parametrize(
    "lookup",
    [
        ("map", "camera", {"rate": 3.0}),
        ("map", "camera", {"topics": {"/tf": "", "/tf_static": "", "/more": ""}}),
        ("odom", "camera", {}),
    ],
)
def test_another_lookup_is_not_taken_for_done(runs, out, lookup):
    first = mapped(runs, out)
    *ends, options = lookup
    assert bag.map_recordings(runs, *ends, out, workers=1, **options).done == first.done
    assert bag.map_recordings(runs, *ends, out, workers=1, **options).skipped == first.done


def test_a_recording_that_has_changed_is_done_again(runs, out):
    first = mapped(runs, out)
    run, folder = runs / "monday" / "run.mcap", runs / "monday" / "folder"
    write_mcap(run, drive(41))
    os.utime(folder / "metadata.yaml", ns=(1, 1))
    second = mapped(runs, out)
    assert set(second.done) == {str(run), str(folder)} and len(second.skipped) == 2
    columns, _ = contents(out / os.path.basename(first.done[str(run)]))
    assert len(columns["stamp_ns"]) == 41


def test_two_runs_at_once_into_one_folder_do_the_same_as_one(runs, out, tmp_path):
    mapped(runs, tmp_path / "alone")
    results = []
    threads = [threading.Thread(target=lambda: results.append(mapped(runs, out))) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [len(one.done) + len(one.skipped) for one in results] == [4, 4]
    assert tables(out) == tables(tmp_path / "alone")
    assert not list(out.glob(".*"))


# Names of tables.


def test_tables_of_equal_names_in_different_folders_differ_and_stay():
    assert table_of("/a/run.mcap", "/out") == "/out/run-8b8a51f97ab1.parquet"
    assert table_of("/b/run.mcap", "/out") != "/out/run-8b8a51f97ab1.parquet"


@pytest.mark.parametrize("name", ["é" * 120 + ".mcap", "_run.mcap", ".mcap", "run.2026", "a\udcff.mcap"])
def test_a_table_has_a_name_that_readers_find(tmp_path, name):
    path = table_of(str(tmp_path / name), str(tmp_path))
    assert os.path.basename(path)[0] not in "._" and path.endswith(".parquet")
    with open(path, "w"):
        pass


# Which recordings are meant.


def test_a_folder_is_searched_and_one_of_rosbag2_is_one_recording(runs):
    (runs / "notes.txt").write_text("nothing")
    (runs / "monday" / "metadata.yaml").write_text("of something else")
    found = ["monday/folder", "monday/run.mcap", "split", "tuesday/run.mcap"]
    assert find_recordings(str(runs)) == [str(runs / name) for name in found]
    assert find_recordings(runs / "split") == [str(runs / "split")]
    assert find_recordings(runs / "monday" / "run.mcap") == [str(runs / "monday" / "run.mcap")]
    compressed = (runs / "tuesday" / "run.mcap").rename(runs / "tuesday" / "run.mcap.zstd")
    assert find_recordings(runs / "tuesday") == find_recordings(compressed) == [str(compressed)]
    unfinished = compressed.rename(runs / "tuesday" / "run.bag.active")  # reported as failed
    assert find_recordings(runs / "tuesday") == [str(unfinished)]


def test_paths_are_taken_as_they_are_and_each_once(runs):
    (runs / "link.mcap").symlink_to(runs / "monday" / "run.mcap")
    run = str(runs / "monday" / "run.mcap")
    gone = str(runs / "gone.mcap")
    assert find_recordings([run, runs / "link.mcap", gone]) == [run, gone]
    assert find_recordings([gone, runs / "tuesday"]) == [gone, str(runs / "tuesday" / "run.mcap")]
    [part] = (runs / "split").glob("*_0.mcap")
    assert find_recordings([part, runs / "split"]) == [str(runs / "split")]
    (runs / "empty").mkdir()
    for nothing in (runs / "empty", [runs / "empty"], []):
        with pytest.raises(FileNotFoundError):
            find_recordings(nothing)


@pytest.mark.parametrize(
    "options, text",
    [
        ({"at": "/scan", "rate": 1.0}, "at and rate are mutually exclusive"),
        ({"workers": 2, "scheduler": "tcp://127.0.0.1:1"}, "workers and scheduler are mutually exclusive"),
        ({"workers": 0}, "workers: expected at least 1, got 0"),
        ({"rate": 0.0}, "rate: expected a number above 0 Hz, got 0"),
        ({"topics": []}, "topics: expected at least one topic, got none"),
    ],
)
def test_options_that_make_no_sense_are_refused_before_anything_is_read(runs, out, options, text):
    with pytest.raises(ValueError, match=text):
        bag.map_recordings(runs, "map", "camera", out, **options)
    for frames in (("/map", "camera"), ("map", "/camera"), ("map", "")):
        with pytest.raises(InvalidArgumentException):
            bag.map_recordings(runs, *frames, out)
    assert not out.exists()


# Where it is done.


def test_two_processes_do_the_same_as_one_core(runs, out, tmp_path):
    (runs / "broken.mcap").write_bytes(b"broken")
    one = mapped(runs, tmp_path / "one")
    command = (Path(__file__).with_name("maps_recordings.py"), str(runs), str(out))
    with killed(start(*command, stdout=subprocess.PIPE)) as program:
        said, _ = program.communicate(timeout=3 * DEADLINE_S)
    assert said == f"<tf2_ros_tools.bag.MappedRecordings: 4 done, 0 skipped, 1 failed, in {str(out)!r}>\n"
    assert tables(out) == tables(tmp_path / "one")
    assert findings(mapped(runs, out)) == findings(one)


def test_the_workers_run_nothing_for_who_has_not_their_keys():
    with local_workers(1) as client:
        address = client.scheduler.address
        strangers = (
            (address, distributed.Security.temporary()),
            (address.replace("tls://", "tcp://"), None),
        )
        for address, security in strangers:
            with pytest.raises(OSError):
                distributed.Client(address, security=security, timeout=2, set_as_default=False)
        assert client.submit(sum, [1, 2]).result(DEADLINE_S) == 3


def test_a_recording_that_kills_its_worker_stops_nobody(runs, out):
    settings = {
        "distributed.scheduler.allowed-failures": 0,
        "distributed.deploy.lost-worker-timeout": "1 ms",  # less than a worker takes to start again
    }
    with dask.config.set(settings), local_workers(1) as client:
        client.register_plugin(Deadly("split"))
        result = mapped(runs, out, scheduler=client)
    [(failed, why)] = result.failed.items()
    assert failed == str(runs / "split") and why.startswith("KilledWorker: ")
    assert len(result.done) == 3


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL], ids=lambda how: how.name)
def test_an_interrupted_run_ends_at_once_and_the_next_one_continues(tmp_path, out, how):
    (tmp_path / "runs").mkdir()
    first = write_mcap(tmp_path / "runs" / "0.mcap", drive(1500), chunk_size=100_000)
    for i in range(1, 50):
        os.link(first, tmp_path / "runs" / f"{i}.mcap")
    options = {"stderr": subprocess.PIPE, "start_new_session": True}
    command = (Path(__file__).with_name("maps_recordings.py"), str(tmp_path / "runs"), str(out))
    with killed(start(*command, **options)) as program:
        until(lambda: state(out))
        children = psutil.Process(program.pid).children(recursive=True)
        # As a terminal does it: to all of the program's group.
        os.killpg(program.pid, how)
        begin = time.monotonic()
        _, said = program.communicate(timeout=DEADLINE_S)
        assert time.monotonic() - begin < DEADLINE_S / 2  # Dask gives busy workers four seconds
    assert program.returncode == -how
    assert said.count("Traceback") == (how == signal.SIGINT), said
    _, alive = psutil.wait_procs(children, timeout=DEADLINE_S)
    assert not alive
    done = len(state(out))
    assert 0 < done < 50
    result = mapped(tmp_path / "runs", out)
    assert len(result.skipped) == done and len(result.done) == 50 - done
    assert not result.failed
