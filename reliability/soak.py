"""
Run a node with real traffic for a long time, and check that it does not grow.

A publisher sends 1000 transforms 100 times a second. The node under test runs in a separate process. It looks
up 200 transforms a second, has 100 pending awaits, of which about 100 expire each second, cancels 20 futures
a second and drops as many, runs a message filter, and restarts a second listener every 10 s. Each answer is
checked, and the received messages are compared with those that were sent.

During the warm-up, the node is stopped for 6 s. The middleware keeps the memory that waiting messages needed,
so this memory does not grow later, when the machine is busy. Latencies are measured after the warm-up.

Memory, threads and descriptors are read every two seconds. After the warm-up, a line is fitted to the medians
of windows. It may rise by less than 4 MB of the C heap, 8 MB of resident memory, 5000 of Python's blocks, and
1.5 threads or descriptors. A longer run detects smaller leaks. With 100 awaits a second, an hour detects 13
bytes of the C heap per await, or an object left behind by every 60th; 2 minutes detect 480 bytes per await,
three objects per five awaits, and a thread or descriptor per restart of the listener.
"""

import argparse
import json
import os
import signal
import statistics
import subprocess
import sys
import threading
import time
from itertools import combinations, pairwise
from pathlib import Path

from reliability.own_domain import ROOT, use_own_domain
from reliability.pythons import environment_of_children

WARM_UP_S, WARM_UP_SHARE = 35.0, 0.1  # whichever is longer
WINDOWS = 9
MEGABYTE = 1e6
# How much each may rise between the warm-up and the end.
BOUNDS = {"resident": 8e6, "heap": 4e6, "blocks": 5000.0, "threads": 1.5, "descriptors": 1.5}
UNITS = {"resident": ("MB", MEGABYTE), "heap": ("MB", MEGABYTE)}
# From the beginning. At the rate of the publisher, fewer messages than anybody keeps.
STOPPED_S, CONTINUED_S, SETTLED_S = 10.0, 16.0, 30.0
END_S = 400.0


def rise_per_second(times_s, values):
    """
    How fast the medians of windows rise: a few samples far off change nothing, nor does a single step.

    A step comes where the machine was busy: the middleware keeps the memory that it needed for the messages
    which had not been taken yet. So of the median slope of all pairs of windows and that of neighbours, the
    smaller one counts.
    """
    size = max(1, len(values) // WINDOWS)
    medians = [
        (statistics.median(times_s[i : i + size]), statistics.median(values[i : i + size]))
        for i in range(0, len(values) - size + 1, size)
    ]
    return min(
        statistics.median((b[1] - a[1]) / (b[0] - a[0]) for a, b in pairs)
        for pairs in (list(combinations(medians, 2)), list(pairwise(medians)))
    )


class Judgement:
    """Of the samples of one quantity."""

    def __init__(self, name, times_s, values):
        self.unit, self._scale = UNITS.get(name, ("", 1))
        self.name = name
        self.least, self.most = min(values) / self._scale, max(values) / self._scale
        seconds = times_s[-1] - times_s[0]
        self.rise_per_minute = rise_per_second(times_s, values) * 60 / self._scale
        self.bound_per_minute = BOUNDS[name] / seconds * 60 / self._scale
        self.is_flat = self.rise_per_minute < self.bound_per_minute

    def __str__(self):
        verdict = "flat" if self.is_flat else "RISES"
        return (
            f"{self.name:<12}{self.least:>12.2f}{self.most:>12.2f}{self.rise_per_minute:>12.3f}"
            f"{self.bound_per_minute:>12.3f} {self.unit:<3} {verdict}"
        )


def judgements(samples):
    """What the samples after the warm-up say."""
    times_s = [sample["time"] for sample in samples]
    warm_s = times_s[0] + max(WARM_UP_S, WARM_UP_SHARE * (times_s[-1] - times_s[0]))
    warm = [sample for sample in samples if sample["time"] >= warm_s]
    if len(warm) < WINDOWS:
        raise SystemExit(f"only {len(warm)} samples after the warm-up: run it for longer")
    times_s = [sample["time"] for sample in warm]
    return [Judgement(name, times_s, [sample[name] for sample in warm]) for name in BOUNDS]


class Soak:
    """The two processes, and what they said."""

    def __init__(self, leak_bytes):
        origin_ns = time.monotonic_ns()
        path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
        environment = environment_of_children(PYTHONFAULTHANDLER="1", PYTHONUNBUFFERED="1", PYTHONPATH=path)

        def start(module, *arguments):
            return subprocess.Popen(
                [sys.executable, "-m", f"reliability.{module}", str(origin_ns), *map(str, arguments)],
                cwd=ROOT,
                env=environment,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )

        self.samples, self.report = [], None
        self._node = start("soak_node", leak_bytes)
        self._publisher = start("soak_traffic")
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def run(self, minutes):
        """Let it run; what went wrong."""
        begin = time.monotonic()
        todo = [
            (STOPPED_S, lambda: self._node.send_signal(signal.SIGSTOP)),
            (CONTINUED_S, lambda: self._node.send_signal(signal.SIGCONT)),
            (SETTLED_S, lambda: print("settled", file=self._node.stdin, flush=True)),
        ]
        try:
            while (passed := time.monotonic() - begin) < minutes * 60:
                for process, name in ((self._node, "the node"), (self._publisher, "the publisher")):
                    if process.poll() is not None:
                        return [f"{name} has ended with {process.returncode}"]
                while todo and passed >= todo[0][0]:
                    todo.pop(0)[1]()
                time.sleep(0.2)
            return self._end()
        except (subprocess.TimeoutExpired, OSError) as error:
            return [f"it does not end: {error}"]
        finally:
            for process in (self._node, self._publisher):
                process.kill()
                process.wait()
            self._reader.join()

    def _end(self):
        print(file=self._publisher.stdin, flush=True)
        sent = self._publisher.stdout.readline().split()
        if not sent:
            return ["the publisher has not said how much it sent"]
        _, last_ns, points = map(int, sent)
        print("end", last_ns, points, file=self._node.stdin, flush=True)
        status = self._node.wait(END_S)
        print(file=self._publisher.stdin, flush=True)
        publisher_status = self._publisher.wait(END_S)
        self._reader.join()
        problems = [] if self.report is None else self.report["problems"]
        if status or publisher_status or self.report is None:
            problems = [*problems, f"the node ended with {status}, the publisher with {publisher_status}"]
        return problems

    def _read(self):
        for line in self._node.stdout:
            said = json.loads(line)
            if "report" in said:
                self.report = said["report"]
            else:
                self.samples.append({"time": time.monotonic(), **said, **self._from_outside()})

    def _from_outside(self):
        folder = Path("/proc") / str(self._node.pid)
        lines = (line.split() for line in (folder / "status").read_text().splitlines())
        status = {line[0]: line[1] for line in lines if len(line) > 1}
        return {
            # Without the memory that Fast DDS shares with other processes.
            "resident": int(status["RssAnon:"]) * 1024,
            "threads": int(status["Threads:"]),
            "descriptors": len(os.listdir(folder / "fd")),
        }


def milliseconds(seconds):
    return f"{seconds * 1e3:>10.3f}"


def summary(report, judged, problems):
    """One page."""
    lines = [f"{'':<12}{'least':>12}{'most':>12}{'rise/min':>12}{'bound/min':>12}", *map(str, judged), ""]
    if report is not None:
        columns = ("50", "90", "99", "99.9", "largest")
        lines.append(f"{'milliseconds':<20}{'count':>10}" + "".join(f"{column:>10}" for column in columns))
        for name, one in report["latencies"].items():
            lines.append(f"{name:<20}{one['count']:>10}" + "".join(milliseconds(one[c]) for c in columns))
        lines += ["", ", ".join(f"{count} {name}" for name, count in report["counts"].items())]
    failed = [
        f"{one.name} rises by {one.rise_per_minute:.3f} {one.unit} a minute"
        for one in judged
        if not one.is_flat
    ]
    lines += ["", *(f"PROBLEM: {text}" for text in [*problems, *failed])]
    lines.append("failed" if problems or failed else "passed")
    return "\n".join(lines), not (problems or failed)


def main(arguments=None):
    """The exit status: 0 where nothing grew and nothing was wrong or lost."""
    parser = argparse.ArgumentParser(
        prog="python -m reliability.soak",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--minutes", type=float, default=60.0, help="how long (default: 60; at least 1)")
    parser.add_argument("--samples", type=Path, help="write the samples to this file, as lines of JSON")
    parser.add_argument(
        "--leak",
        type=int,
        default=0,
        metavar="BYTES",
        help="leak an object of this many bytes for each await that expires, to check that it is detected",
    )
    options = parser.parse_args(arguments)
    print(f"soak for {options.minutes:g} minutes in ROS domain {use_own_domain()}", flush=True)
    soak = Soak(options.leak)
    problems = soak.run(options.minutes)
    if options.samples:
        options.samples.write_text("".join(json.dumps(sample) + "\n" for sample in soak.samples))
    judged = judgements(soak.samples) if len(soak.samples) > 2 * WINDOWS else []
    text, passed = summary(soak.report, judged, problems if judged else [*problems, "too few samples"])
    print(text, flush=True)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
