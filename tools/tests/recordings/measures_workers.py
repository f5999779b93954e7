# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Measures worker processes that get a buffer: how soon they can look poses up, and how much memory they need.

`measures_workers.py SAMPLES WORKERS [METHOD ...]` makes a buffer of two frames, hands it to workers that are
started in each way of multiprocessing, or by Dask, as it was loaded and as it was opened from a frozen file,
and lets each of them look up the same poses. A small buffer shows what a worker needs without samples. Prints
a JSON object: lists of a number for each worker, in seconds and bytes, by method and buffer. The seconds are
those until a worker has its buffer; Dask starts its workers before.
"""

import json
import math
import multiprocessing
import os
import re
import sys
import tempfile
import time

import numpy as np

from tf2_ros import Buffer

S = 1_000_000_000
LOOKUPS = 10_000
DEADLINE_S = 120


def made(samples):
    """A buffer with this many samples of odom in map, and of base_link in odom, at 100 Hz."""
    count = samples // 2
    buffer = Buffer(cache_time=math.inf, max_bytes=1 << 40)
    poses = np.zeros((2 * count, 7))
    poses[:, 0], poses[:, 6] = np.arange(2 * count), 1.0
    buffer.__setstate__(
        buffer.__getstate__()
        | {
            "frames": [("odom", False, "slam", count), ("base_link", False, "wheels", count)],
            "stamps": np.tile(S + np.arange(count) * (S // 100), 2),
            "transforms": poses,
            "parents": np.repeat(np.array([0, 1], np.uint32), count),
            "parent_names": ["map", "odom"],
        }
    )
    return buffer


def memory():
    """Bytes of this process that no other shares, and its share of what it maps with others."""
    with open("/proc/self/smaps_rollup") as file:
        sizes = dict(re.findall(r"^(\w+): +(\d+) kB$", file.read(), re.MULTILINE))
    private = int(sizes["Private_Clean"]) + int(sizes["Private_Dirty"])
    return 1024 * private, 1024 * int(sizes["Pss"])


def look_up(buffer):
    times = np.random.default_rng(1).integers(*buffer.time_range("map", "base_link"), LOOKUPS)
    return float(buffer.lookup_transforms("map", "base_link", times)[0].sum())


def work(buffer, begun, barrier, results):
    ready = time.monotonic() - begun
    total = look_up(buffer)
    barrier.wait(DEADLINE_S)
    private, pss = memory()
    barrier.wait(DEADLINE_S)
    results.put((ready, private, pss, total))


def measured(method, buffer, workers):
    context = multiprocessing.get_context(method)
    barrier, results = context.Barrier(workers), context.Queue()
    processes = []
    for _ in range(workers):
        arguments = (buffer, time.monotonic(), barrier, results)
        processes.append(context.Process(target=work, args=arguments))
        processes[-1].start()
    found = [results.get(timeout=DEADLINE_S) for _ in processes]
    for process in processes:
        process.join(DEADLINE_S)
        assert process.exitcode == 0, process.exitcode
    return dict(zip(("ready_s", "private", "pss", "totals"), zip(*found, strict=True), strict=True))


kept = []  # of a worker of Dask


def work_for_dask(buffer, begun):
    ready = time.monotonic() - begun
    kept.append(buffer)
    return ready, look_up(buffer)


def measured_with_dask(buffer, workers):
    from distributed import Client, LocalCluster

    with (
        LocalCluster(
            n_workers=workers, threads_per_worker=1, host="127.0.0.1", dashboard_address=None
        ) as cluster,
        Client(cluster) as client,
    ):
        client.wait_for_workers(workers)
        names = [*client.scheduler_info(n_workers=-1)["workers"]]
        futures = [
            client.submit(work_for_dask, buffer, time.monotonic(), workers=[one], pure=False) for one in names
        ]
        ready, totals = zip(*client.gather(futures), strict=True)
        private, pss = zip(*client.run(memory).values(), strict=True)
    return {"ready_s": ready, "private": private, "pss": pss, "totals": totals}


def main(samples, workers, *methods):
    samples, workers = int(samples), int(workers)
    loaded = made(samples)
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "drive.tf2")
        loaded.freeze(path)
        buffers = {"small": made(8), "frozen": Buffer.open(path), "loaded": loaded}
        found = {"file": os.path.getsize(path)}
        for method in methods or ("fork", "forkserver", "spawn"):
            found[method] = {
                name: measured_with_dask(buffer, workers)
                if method == "dask"
                else measured(method, buffer, workers)
                for name, buffer in buffers.items()
            }
    print(json.dumps(found))


if __name__ == "__main__":
    main(*sys.argv[1:])
