"""
Search for leaks: `python -m reliability.leaks`, behind `make leaks`.

Each public method is called a million times, or for a minute, in a separate process. A leak is reported if
Python's objects, the bytes of C's heap or resident memory grow in the first half of these calls and again in
the second, or if there are more threads or descriptors at the end.

With `--lost`, each case of a group is called a few times in the build with AddressSanitizer. LeakSanitizer
then looks for memory that nothing points to any more.
"""

import argparse
import ctypes
import gc
import json
import os
import re
import subprocess
import sys
import time
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MOST_CALLS = 1_000_000
WARM_UP = 0.2  # of the time, and of the calls
LOST_CALLS, LOST_S = 100, 2.0  # of each case with --lost, whichever comes first
# Fewer blocks are not one of each call: what only a frame of another thread points to looks lost.
LOST_LEAST = 10
SETTLE_S = 5.0  # until threads and descriptors of what was destroyed are gone, at most

# What a half may grow by, without a leak: in total, and for each call. One lost object in 100 calls shows.
ALLOWED = {"objects": (100, 0.01), "heap_bytes": (32 << 10, 0.1), "resident_bytes": (1 << 20, 1.0)}
MORE_ALLOWED = {"threads": 0, "descriptors": 0}


@dataclass(frozen=True)
class Size:
    """Of a process."""

    calls: int
    objects: int
    heap_bytes: int
    resident_bytes: int
    threads: int
    descriptors: int


class _Mallinfo2(ctypes.Structure):
    _fields_ = [
        (name, ctypes.c_size_t)
        for name in "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost".split()
    ]


def _heap_bytes():
    # Bytes in use, and those of blocks so large that they have mappings of their own.
    mallinfo2 = ctypes.CDLL(None).mallinfo2
    mallinfo2.restype = _Mallinfo2
    info = mallinfo2()
    return info.uordblks + info.hblkhd


def size(calls):
    """What this process is made of, after so many calls."""
    gc.collect()
    with open("/proc/self/statm") as statm:
        resident = int(statm.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    return Size(
        calls=calls,
        objects=sys.getallocatedblocks(),
        heap_bytes=_heap_bytes(),
        resident_bytes=resident,
        threads=len(os.listdir("/proc/self/task")),
        descriptors=len(os.listdir("/proc/self/fd")),
    )


def measure(action, seconds, most_calls=MOST_CALLS, settle_s=SETTLE_S, rest_s=0.0):
    """Sizes after warming up, after half of the calls, and after all of them; each after a rest."""
    sizes, calls = [], 0
    for share in (WARM_UP, (1 - WARM_UP) / 2, (1 - WARM_UP) / 2):
        until_s = time.monotonic() + share * seconds
        most = calls + share * most_calls
        while calls < most and time.monotonic() < until_s:
            action()
            calls += 1
        time.sleep(rest_s)
        sizes.append(size(calls))
    until_s = time.monotonic() + settle_s
    while _more(sizes) and time.monotonic() < until_s:
        time.sleep(0.05)
        sizes[-1] = size(calls)
    return sizes


def _more(sizes):
    first, last = sizes[0], sizes[-1]
    return [name for name, most in MORE_ALLOWED.items() if getattr(last, name) - getattr(first, name) > most]


def leaks(sizes, of_others=None):
    """What grew, as text, by more than what others leave for each call; empty: nothing."""
    found = []
    for name, (constant, per_call) in ALLOWED.items():
        per_call += (of_others or {}).get(name, 0)
        grown = [
            (getattr(after, name) - getattr(before, name), after.calls - before.calls)
            for before, after in zip(sizes, sizes[1:], strict=False)
        ]
        if all(growth > constant + per_call * calls for growth, calls in grown):
            total, calls = map(sum, zip(*grown, strict=True))
            found.append(f"{name} {total:+} in {calls} calls, {total / max(calls, 1):.3g} per call")
    for name in _more(sizes):
        found.append(f"{name} {getattr(sizes[0], name)} -> {getattr(sizes[-1], name)}")
    return found


def main(arguments=None):
    parser = argparse.ArgumentParser(prog="python -m reliability.leaks", description=__doc__.split("\n\n")[1])
    parser.add_argument("--seconds", type=float, default=60, help="for each case at most (default: 60)")
    parser.add_argument("--only", default="", metavar="TEXT", help="only cases with this in their names")
    parser.add_argument("--list", action="store_true", help="print the cases; fail if a public name has none")
    parser.add_argument("--lost", action="store_true", help="look for lost memory, with LeakSanitizer")
    parser.add_argument("--case", help=argparse.SUPPRESS)
    parser.add_argument("--lost-of", help=argparse.SUPPRESS)
    asked = parser.parse_args(arguments)
    sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(ROOT / "tests" / "support")]
    # Before anything imports rclpy: a ROS domain of its own.
    import conftest  # noqa: F401

    if asked.case:
        return _run_here(asked.case, asked.seconds)
    if asked.lost_of:
        return _look_for_lost(asked.lost_of)
    from reliability import leak_cases

    names = leak_cases.names()
    without = leak_cases.without_case(names)
    for name in without:
        print(f"{name} has no case in reliability/leak_cases.py")
    chosen = [name for name in names if asked.only in name]
    if asked.list:
        print(*chosen, sep="\n")
        return 1 if without else 0
    if asked.lost:
        return _run_lost([title for title in leak_cases.GROUPS if asked.only in title])
    return max([_run(name, asked.seconds) for name in chosen], default=1) or bool(without)


def _run_here(name, seconds):
    from reliability import leak_cases

    with ExitStack() as stack:
        action = leak_cases.action(name, stack)
        rest_s = leak_cases.REST_S.get(name.partition(".")[0], 0.0)
        measured = [asdict(one) for one in measure(action, seconds, rest_s=rest_s)]
        # On a descriptor of its own: cases may print.
        os.write(int(os.environ["LEAKS_ANSWER"]), json.dumps(measured).encode())
    return 0


def _run(name, seconds):
    from reliability import leak_cases

    reading, writing = os.pipe()
    command = [sys.executable, "-m", "reliability.leaks", "--case", name, "--seconds", str(seconds)]
    environment = {**os.environ, "LEAKS_ANSWER": str(writing)}
    ended = subprocess.run(
        command,
        cwd=ROOT,
        env=environment,
        pass_fds=[writing],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    os.close(writing)
    with open(reading) as pipe:
        answer = pipe.read()
    if ended.returncode != 0 or not answer:
        print(f"FAILED {name}: {ended.stderr[-2000:]}", flush=True)
        return 1
    sizes = [Size(**one) for one in json.loads(answer)]
    is_ours = "(for comparison)" not in name
    found = leaks(sizes, leak_cases.OF_RCLPY.get(name))
    print(
        f"{'LEAKS' if found else 'ok   '} {name}: {'; '.join(found) or f'{sizes[-1].calls} calls'}",
        flush=True,
    )
    return 1 if found and is_ours else 0


def _look_for_lost(title):
    from reliability import leak_cases

    with ExitStack() as stack:
        for action in leak_cases.GROUPS[title].make(stack).values():
            _repeat(action)
    gc.collect()
    ctypes.CDLL(None).__lsan_do_recoverable_leak_check()
    # The interpreter leaves behind much that it never frees; that is not looked at.
    os._exit(0)


def _repeat(action):
    # In a function that has ended when lost memory is looked for: what only a frame of Python points to, in
    # memory from mmap, looks lost. One call shows a lost block; more of them show whether each loses one.
    until_s = time.monotonic() + LOST_S
    for _ in range(LOST_CALLS):
        action()
        if time.monotonic() > until_s:
            break


def _run_lost(titles):
    from reliability import sanitize

    reports = sanitize.reports_of("leak")
    folder, environment = sanitize.prepared("address", reports)
    environment["ASAN_OPTIONS"] += ":detect_leaks=1:leak_check_at_exit=0"
    environment["LSAN_OPTIONS"] = f"use_tls=0:suppressions={sanitize.SUPPRESSIONS}/leak.txt"
    failed = []
    for title in titles:
        command = [sys.executable, "-m", "reliability.leaks", "--lost-of", title]
        out, err = subprocess.DEVNULL, subprocess.PIPE
        ended = subprocess.run(command, cwd=folder, env=environment, stdout=out, stderr=err, text=True)
        said = "".join(report.read_text(errors="replace") for report in sorted(reports.iterdir()))
        blocks = [int(count) for count in re.findall(r"leak of \d+ byte\(s\) in (\d+) object", said)]
        if ended.returncode != 0:
            print(f"FAILED {title}: {ended.stderr[-2000:]}", flush=True)
            failed.append(title)
        elif max(blocks, default=0) >= LOST_LEAST:
            print(f"LOST   {title}\n{said}", flush=True)
            failed.append(title)
        else:
            print(
                f"ok     {title}: {len(blocks)} places with at most {max(blocks, default=0)} blocks",
                flush=True,
            )
        for report in reports.iterdir():
            report.unlink()
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
