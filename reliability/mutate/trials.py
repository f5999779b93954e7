"""
Owns running tests against mutants: a pytest session that collects once, and forks for each mutant.

First each test is run without a mutant, to learn which mutants it reaches and how long it takes. Then a
mutant is given to the tests that reach it, those first that have killed the most, until one fails, crashes,
or hangs. A kill counts only if it happens again, and if the same test passes without the mutant. Of a test
that depends on nothing but the code, one failure is enough.
"""

import ctypes
import gc
import hashlib
import json
import mmap
import os
import resource
import select
import signal
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

# The tests that work on trees, waiters and lookups; of the others none would find what these overlook.
FILES = (
    "test_conformance.py", "test_tf2_py_*.py", "test_model*.py", "test_waiting*.py", "test_numpy*.py",
    "test_travel*.py", "test_shared_reading.py", "test_plain_buffer.py", "test_frame_tree.py",
    "test_tf2_geometry_msgs.py", "test_buffer.py", "test_error_texts.py",
    "test_malformed_objects.py", "test_bag.py",
)  # fmt: skip
# Those that take longer than ten seconds, and the one that is another one each time.
LEFT_OUT = (
    "test_sixty_four_readers",
    "test_readers_outlive_owners_that_are_killed_at_any_moment",
    "test_of_a_process_whose_every_thread_is_busy",
    "test_names_of_any_kind_lie_apart[that fell together]",
    "[fresh ",
)
PATIENCE_S = 20.0
STEADY = (
    "test_conformance.py", "test_tf2_py_frames.py", "test_tf2_py_history.py", "test_tf2_py_inserting.py",
    "test_tf2_py_listings.py", "test_tf2_py_lookup.py", "test_tf2_py_waiters_random.py", "test_travel.py",
)  # fmt: skip
SLACK_S = 5.0  # how much longer than usual a test may take, beside FACTOR times its time
FACTOR = 10
MEMORY = 6 << 30  # bytes that a mutant may allocate
LISTED_S = 3.0  # of tests for a mutant that is said to be equivalent
FIRST = 25  # tests that are run in the order of their success ...
# ... then those that compare long sequences with what is known of them; the others follow file by file.
STRONG = (
    "test_answers_as_recorded[", "test_any_order_of_arrival", "test_every_place_of_a_long_history_is_found",
    "test_no_waiter_is_pending_whose_lookup_would_answer", "test_each_ends_and_leaves_nothing[0]",
    "test_a_random_buffer_arrives_as_it_was_and_goes_on_so", "test_model",
    "test_after_every_step_it_holds_what_the_owner_does",
)  # fmt: skip


class Trials:
    """The plugin of the session; ``plan`` says which mutants to try, and where the results go."""

    def __init__(self, plan, out):
        self._plan = plan
        self._out = out
        self._chosen = ctypes.c_int.in_dll(ctypes.CDLL(plan["library"]), "tf2_mutant")
        with open(plan["reached"], "r+b") as file:
            self._reached = mmap.mmap(file.fileno(), 0)
        self._report = None  # in a child: the end of its pipe
        self._stop_at_failure = False
        self._kills = Counter()
        self._sound = {}  # by test: whether it passes alone without a mutant

    def pytest_collection_modifyitems(self, config, items):
        left = [item for item in items if any(part in item.nodeid for part in LEFT_OUT)]
        items[:] = [item for item in items if item not in left]
        config.hook.pytest_deselected(items=left)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session):
        if session.testsfailed:
            raise session.Interrupted("a test file cannot be read")
        # The garbage of the children, which the tests collect often, is theirs alone.
        gc.collect()
        gc.freeze()
        self._record(session.items)
        self._kills.update(test for test in self._plan["killers"].values() if test in self._facts)
        for number in self._plan["mutants"]:
            began = time.monotonic()
            result = self._try(number)
            result["seconds"] = time.monotonic() - began
            self._say(json.dumps({"mutant": number, **result}))
        return True

    def pytest_runtest_logreport(self, report):
        if self._report is not None and report.failed:
            os.write(self._report, b"failed\n")
            if self._stop_at_failure:
                os._exit(0)

    def _say(self, text):
        self._out.write(text + "\n")
        self._out.flush()

    # Without a mutant.

    def _record(self, items):
        kept = Path(self._plan["reach"])
        known = json.loads(kept.read_text()) if kept.exists() else {}
        helpers = sorted(Path("tests").rglob("*.py"))
        common = hashlib.sha256(self._plan["sources"].encode())
        for file in helpers:
            if not file.name.startswith("test_"):
                common.update(file.read_bytes())
        self._items, self._facts, by_file = {}, {}, {}
        for item in items:
            self._items[item.nodeid] = item
            by_file.setdefault(str(item.path), []).append(item)
        for file, own in by_file.items():
            digest = hashlib.sha256(common.digest() + Path(file).read_bytes()).hexdigest()
            if known.get(file, {}).get("digest") != digest:
                known[file] = {"digest": digest, "tests": {}}
            facts = known[file]["tests"]
            # Those that have failed before get another chance.
            missing = [item for item in own if facts.get(item.nodeid, {"failed": True})["failed"]]
            if missing:
                facts.update(self._record_file(missing))
                kept.write_text(json.dumps(known))
                took = sum(facts[item.nodeid]["seconds"] for item in missing if item.nodeid in facts)
                self._say(f"recorded {len(missing)} of {Path(file).name}: {took:.1f} s")
            self._facts.update(facts)
        for test, fact in list(self._facts.items()):
            if fact["failed"]:
                self._say(f"fails without a mutant, left out: {test}")
                del self._facts[test]
        self._facts = {test: fact for test, fact in self._facts.items() if test in self._items}
        self._by_mutant = {}
        for test, fact in self._facts.items():
            for number in fact["reaches"]:
                self._by_mutant.setdefault(number, []).append(test)

    def _record_file(self, items):
        facts = {}
        for event, *rest in self._run(items, 0, lambda item: 300.0, record=True):
            if event == "done":
                test, seconds, failed, reaches = rest
                facts[test] = {"seconds": seconds, "failed": failed, "reaches": reaches}
            elif event in {"hung", "crashed"}:
                self._say(f"{event} without a mutant: {rest}")
        return facts

    # With one.

    def _try(self, number):
        tests = self._ordered(self._by_mutant.get(number, []), self._plan["killers"].get(str(number)))
        if not tests:
            return {"outcome": "not reached"}
        reached_by = len(tests)
        budget = LISTED_S if number in self._plan["listed"] else self._plan["budget"]
        if budget:
            tests = self._within(tests, budget)
        unsteady, tested = [], len(tests)
        while tests:
            how, test = self._first_failure(number, tests)
            if how is None:
                break
            done = tests[: tests.index(test) + 1]
            if how == "failed" and any(part in test for part in STEADY):
                self._kills[test] += 1
                return {"outcome": how, "test": test, "tests": len(done), "unsteady": unsteady}
            if self._is_sound(test):
                again, _ = self._first_failure(number, [test])
                if again is None and len(done) > 1:
                    again, _ = self._first_failure(number, done)
                if again is not None:
                    self._kills[test] += 1
                    return {"outcome": how, "test": test, "tests": len(done), "unsteady": unsteady}
            unsteady.append(test)
            tests = tests[len(done) :]
        return {"outcome": "survived", "unsteady": unsteady, "tests": tested, "reached_by": reached_by}

    def _within(self, tests, budget):
        chosen, left = [], budget
        for test in tests:
            if self._facts[test]["seconds"] <= left:
                left -= self._facts[test]["seconds"]
                chosen.append(test)
        return chosen

    def _ordered(self, tests, killer):
        seconds = {test: self._facts[test]["seconds"] for test in tests}
        by_success = sorted(tests, key=lambda test: -(self._kills[test] + 0.05) / (seconds[test] + 0.02))
        first = by_success[:FIRST]
        strong = [test for test in by_success[FIRST:] if any(part in test for part in STRONG)]
        first += sorted(strong, key=seconds.get)
        by_file = {}
        for test in by_success[FIRST:]:
            if test in strong:
                continue
            by_file.setdefault(test.partition("::")[0], []).append(test)
        files = sorted(by_file.values(), key=lambda own: sum(seconds[test] for test in own) / len(own))
        ordered = first + [test for own in files for test in sorted(own, key=seconds.get)]
        return [killer, *(test for test in ordered if test != killer)] if killer in seconds else ordered

    def _is_sound(self, test):
        if test not in self._sound:
            self._sound[test] = self._first_failure(0, [test])[0] is None
        return self._sound[test]

    def _first_failure(self, number, tests):
        """How the first of some tests failed that did, and which; or None twice."""
        items = [self._items[test] for test in tests]

        def limit(item):
            return SLACK_S + FACTOR * self._facts[item.nodeid]["seconds"]

        # A mutant that only makes all of them slow is not found.
        most = PATIENCE_S + 2 * self._plan["budget"]
        began = time.monotonic()
        for event, *rest in self._run(items, number, limit):
            if event in {"failed", "hung", "crashed"}:
                return event, rest[0]
            if self._plan["budget"] and time.monotonic() - began > most:
                break
        return None, None

    # Processes.

    def _run(self, items, number, limit, record=False):
        """
        Run tests in a child process. Yields ``("failed", test)``, ``("hung", test)`` or ``("crashed", test)``
        and ends; with `record`, all are run, and ``("done", test, seconds, failed, mutants reached)`` is told
        of each.
        """
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(reading)
            self._be_child(items, number, writing, record)
        os.close(writing)
        try:
            yield from self._follow(child, reading, items, limit)
        finally:
            os.close(reading)
            for kill, who in ((os.killpg, child), (os.kill, child)):
                try:
                    kill(who, signal.SIGKILL)
                except ProcessLookupError:
                    continue
            os.waitpid(child, 0)

    def _follow(self, child, reading, items, limit):
        at, text = 0, b""
        deadline = time.monotonic() + 30
        while True:
            ready, _, _ = select.select([reading], [], [], max(0.0, deadline - time.monotonic()))
            if not ready:
                yield "hung", items[at].nodeid
                return
            got = os.read(reading, 1 << 16)
            if not got:
                yield "crashed", items[at].nodeid
                return
            text += got
            *lines, text = text.split(b"\n")
            for line in lines:
                word, _, rest = line.partition(b" ")
                if word == b"start":
                    at = int(rest)
                    yield "started", items[at].nodeid
                    deadline = time.monotonic() + limit(items[at])
                elif word == b"failed":
                    yield "failed", items[at].nodeid
                elif word == b"done":
                    yield "done", items[at].nodeid, *json.loads(rest)
                elif word == b"end":
                    return

    def _be_child(self, items, number, report, record):
        # Never returns.
        try:
            os.setsid()
            resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            os.environ["TF2_MUTANT"] = str(number)
            self._chosen.value = number
            self._report = report
            self._stop_at_failure = not record
            for i, (item, following) in enumerate(zip(items, [*items[1:], None], strict=True)):
                os.write(report, b"start %d\n" % i)
                self._reached[:] = bytes(len(self._reached))
                failures = item.session.testsfailed
                began = time.monotonic()
                item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
                if record:
                    seconds = time.monotonic() - began
                    reaches = [k for k, byte in enumerate(self._reached[:]) if byte and k]
                    facts = [seconds, item.session.testsfailed > failures, reaches]
                    os.write(report, b"done " + json.dumps(facts).encode() + b"\n")
            os.write(report, b"end\n")
        finally:
            os._exit(1)


def main(plan_file):
    """Run the session that a plan describes; results are lines of JSON on the original stdout."""
    plan = json.loads(Path(plan_file).read_text())
    out = os.fdopen(os.dup(1), "w")
    log = os.open(plan["log"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(log, 1)
    os.dup2(log, 2)
    from hypothesis import settings

    # The same examples for every mutant, and none that an earlier one has left.
    settings.register_profile("mutants", database=None, derandomize=True, deadline=None)
    files = sorted({str(path) for pattern in FILES for path in Path("tests").glob(pattern)})
    options = ["-q", "-p", "no:cacheprovider", "--hypothesis-profile=mutants"]
    return pytest.main([*options, *(plan["tests"] or files)], plugins=[Trials(plan, out)])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
