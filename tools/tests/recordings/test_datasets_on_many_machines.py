# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The program on the page about datasets that Dask runs on many machines, also if one of them fails."""

import json
import os
import shutil
import signal
import subprocess
import sys
from contextlib import ExitStack

import pytest
from documentation_pages import blocks, named_programs
from processes import killed, run
from tool_paths import DOCS, SAMPLES
from waiting import DEADLINE_S, until

pytestmark = pytest.mark.long("needs pyarrow and Dask")
pandas = pytest.importorskip("pandas")
pytest.importorskip("pyarrow")
distributed = pytest.importorskip("distributed")

PAGE = DOCS / "datasets.md"
PROGRAM = "poses_of_recordings.py"
COUNT = 40


@pytest.fixture
def folder(tmp_path):
    """The samples, a broken recording, and the program of the page."""
    shutil.copytree(SAMPLES, tmp_path, dirs_exist_ok=True)
    (tmp_path / "runs" / "broken.mcap").write_bytes(b"no")
    (tmp_path / PROGRAM).write_text(named_programs(PAGE)[PROGRAM], encoding="utf-8")
    return tmp_path


def test_it_prints_what_the_page_says(folder):
    [said] = [block.code for block in blocks(PAGE) if block.code.startswith("1 of 4: broken.mcap: ")]
    done = run(sys.executable, PROGRAM, cwd=folder)
    assert done.returncode == 0, done.stderr
    shown, expected = (text.splitlines() for text in (done.stdout, said.replace("/data", str(folder))))
    assert [line.partition(": ")[0] for line in shown] == [line.partition(": ")[0] for line in expected]
    assert {line.partition(": ")[2] for line in shown} == {line.partition(": ")[2] for line in expected}
    assert len(pandas.read_parquet(folder / "poses")) == 60


@pytest.fixture
def cluster(folder, tmp_path_factory):
    """The address of a scheduler, and two workers by their addresses; each is a process of its own."""
    file = folder / "scheduler.json"
    with ExitStack() as ends:

        def start(what, *options):
            command = [sys.executable, "-m", "dask", what, "--scheduler-file", file, *options]
            elsewhere = tmp_path_factory.mktemp(what)
            process = subprocess.Popen(command, cwd=elsewhere, stderr=subprocess.DEVNULL)
            return ends.enter_context(killed(process))

        start("scheduler", "--host", "127.0.0.1", "--port", "0", "--dashboard-address", ":0")
        workers = [start("worker", "--nthreads", "1", "--no-nanny") for _ in range(2)]
        address = json.loads(until(lambda: file.exists() and file.read_text()))["address"]
        client = ends.enter_context(distributed.Client(address))
        client.wait_for_workers(len(workers), DEADLINE_S)
        of_pid = {worker.pid: worker for worker in workers}
        yield client, {at: of_pid[pid] for at, pid in client.run(os.getpid).items()}


def stop_a_busy_one(client, workers):
    """Stop a worker that has recordings to read, and get it; None: none has."""
    for address, worker in workers.items():
        worker.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, worker.pid, os.WSTOPPED | os.WNOWAIT)
        if client.processing()[address]:
            return worker
        worker.send_signal(signal.SIGCONT)
    return None


def test_every_row_is_there_once_if_a_worker_is_killed(folder, cluster):
    client, workers = cluster
    runs = [f"copy{i:02}" for i in range(COUNT)]
    for name in runs:
        shutil.copytree(folder / "runs" / "run0", folder / "runs" / name)
    command = [sys.executable, PROGRAM, client.scheduler.address]
    with killed(subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True)) as program:
        until(lambda: stop_a_busy_one(client, workers)).kill()
        out, _ = program.communicate(timeout=DEADLINE_S)
        assert len(client.scheduler_info()["workers"]) == 1
    runs += ["run0", "run1", "run2"]
    counts, results = zip(*(line.split(": ", 1) for line in out.splitlines()), strict=True)
    assert program.returncode == 0 and list(counts) == [f"{count} of 44" for count in range(1, 45)]
    saved = sorted(result for result in results if not result.startswith("broken.mcap: "))
    assert saved == [f"{name}.parquet: 20 rows" for name in runs]
    assert sorted(os.listdir(folder / "poses")) == [f"{name}.parquet" for name in runs]
    table = pandas.read_parquet(folder / "poses")
    found = sorted(zip(table.file, table.frame_index, strict=True))
    assert found == [(str(folder / "runs" / name), index) for name in runs for index in range(20)]
