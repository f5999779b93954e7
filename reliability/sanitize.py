# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Run the suite in builds with sanitizers: `python -m reliability.sanitize`, behind `make sanitize`.

AddressSanitizer and UndefinedBehaviorSanitizer check everything, in a build that also checks each buffer's
invariants after every operation (`tf2_py/engine/engine.pxi`). ThreadSanitizer checks the files in THREADED.
Every process that the tests start runs with the runtime, too, and a report of any of them fails the run,
whatever became of that process.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from reliability.flagged_builds import BUILDS, build, in_processes

SUPPRESSIONS = Path(__file__).resolve().parent / "suppressions"
STACKS = ("-fno-omit-frame-pointer", "-g1")  # those of reports name functions and lines
SELF_CHECK = "-DTF2_SELF_CHECK"
# Deadlines of tests are so much later: a sanitizer makes extensions several times slower.
SLOWNESS = 5
TEST_TIMEOUT_S = 240 * SLOWNESS
PER_CORE = 2  # processes for whole suites, each of which needs 1 GB

# Files and tests that cannot run here, and why.
NOT_HERE = {
    "tests/packaging": "reads sources and pages, and builds the package; make fuzz runs its corpus",
    "tools/tests/packaging": "the same",
    "tests/core/test_allocation_failures.py": "replaces the allocator, as a sanitizer does",
    "tests/core/test_refused_inserts.py::TestLogging::test_many_messages_share_the_lines_of_a_second": "a "
    "slow build does not finish within a second",
    "tests/ros/test_inbox_without_middleware.py::"
    "test_a_flood_of_faults_is_counted_and_only_a_part_of_it_kept_for_the_log": "a sanitizer "
    "keeps memory that was freed",
    "tests/ros/test_threads.py::"
    "test_python_does_not_end_before_a_thread_that_was_started_has_begun[interrupted": "a "
    "sanitizer holds signals back until a thread has begun",
    "tools/tests/common/test_threads.py::"
    "test_one_whose_start_is_interrupted_begins_before_python_ends": "the same",
    "tools/tests/programs/test_tf2_monitor_web.py::"
    "test_chromium_shows_the_table_on_a_network_that_does_not_answer": "Chromium hangs with the runtime",
}
# In a forked child, a thread may have the id of one of the parent's, which the child does not have.
NO_FINDING = re.compile(r"^==\d+==ThreadSanitizer: dup thread with used id .*$", re.MULTILINE)
# Tests that start threads, or fork while threads exist, and call the extensions in them.
THREADED = """
core/test_waits_in_forked_children core/test_lookup core/test_waits_without_node
core/test_lookups_at_many_times core/test_many_times_beside_writers core/test_many_times_in_one_state
core/test_pickles_and_copies core/test_waiters core/test_waiters_random
ros/test_buffer ros/test_buffer_client ros/test_buffer_server ros/test_executor_waitable ros/test_forking
ros/test_message_filter ros/test_rclpy_inside ros/test_records
ros/test_receiving_without_executor ros/test_reception_in_texts
ros/test_readers_beside_writers ros/test_transform_listener ros/test_futures
ros/test_listeners_end_in_any_order
ros/test_waits_random
""".split()
# These first: whoever breaks the engine learns it within minutes.
CORE = ("tests/core/test_*.py",)


@dataclass(frozen=True)
class Kind:
    """A build, and how its runtime is told what to do."""

    cflags: tuple[str, ...]
    runtimes: tuple[str, ...]  # to be preloaded, as gcc names them
    options: dict[str, str]  # variables of the environment; {suppressions} and {log} are filled in
    tests: str  # what is run where no tests are named

    def environment(self, reports):
        """Of the interpreter that runs the tests, beside what it has anyway."""
        places = {"suppressions": SUPPRESSIONS, "log": reports / "report"}
        return {
            "LD_PRELOAD": ":".join(map(_runtime, self.runtimes)),
            # Python's own allocator would hide its blocks from the sanitizer.
            "PYTHONMALLOC": "malloc",
            "TF2_TEST_SLOWNESS": str(SLOWNESS),
            **{name: value.format(**places) for name, value in self.options.items()},
        }


KINDS = {
    "address": Kind(
        cflags=(
            "-fsanitize=address,undefined",
            # What is undefined ends the process by a signal, which AddressSanitizer reports. The runtime of
            # UndefinedBehaviorSanitizer, beside another one, cannot write into a file.
            "-fsanitize-undefined-trap-on-error",
            *STACKS,
            SELF_CHECK,
        ),
        # It looks for what throws exceptions of C++ when the process begins, and rclpy loads that later.
        runtimes=("libasan.so", "libstdc++.so.6"),
        options={
            # The interpreter never frees much of what it has at its end.
            # Tests cut off memory that is read, and see who ends by the signal of that.
            "ASAN_OPTIONS": "detect_leaks=0:handle_abort=1:handle_sigill=1:handle_sigbus=0:"
            "detect_stack_use_after_return=1:log_path={log}:allocator_may_return_null=1:"
            "suppressions={suppressions}/address.txt",
        },
        tests="all",
    ),
    "thread": Kind(
        cflags=("-fsanitize=thread", *STACKS),
        runtimes=("libtsan.so",),
        options={
            # Only our C tells the runtime what it reads and writes. Of the others it sees locks, threads and
            # what goes through functions of the C library, and that alone looks like races where they order
            # their accesses by atomics. The exit status stays that of the program, which tests look at.
            "TSAN_OPTIONS": "ignore_noninstrumented_modules=1:die_after_fork=0:exitcode=0:halt_on_error=0:"
            "handle_sigbus=0:history_size=4:second_deadlock_stack=1:log_path={log}:suppressions={suppressions}/thread.txt",
        },
        tests="threaded",
    ),
}


def main(arguments=None):
    left_out = "\n".join(f"  {test}: {why}" for test, why in NOT_HERE.items())
    parser = argparse.ArgumentParser(
        prog="python -m reliability.sanitize",
        usage="%(prog)s [-h] [address|thread] [what pytest takes ...]",
        description="Run the tests in a build with sanitizers: address runs all, thread only the files in "
        "THREADED of reliability/sanitize.py. Reports are kept in .reliability/reports.",
        epilog=f"What is not run, and why:\n{left_out}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    given = sys.argv[1:] if arguments is None else list(arguments)
    if given[:1] in (["-h"], ["--help"]):
        parser.parse_args(given)
    kinds, of_pytest = (given[:1], given[1:]) if given and given[0] in KINDS else (list(KINDS), given)
    failed = [kind for kind in kinds if not run(kind, of_pytest)]
    return 1 if failed else 0


def run(name, of_pytest):
    """Build, run the tests, print what was reported; whether all was well."""
    kind, reports = KINDS[name], reports_of(name)
    folder, environment = prepared(name, reports)
    command = [*_fixed_addresses(), sys.executable, "-m", "pytest", "--all", "-p", "no:cacheprovider"]
    command += ["-o", f"timeout={TEST_TIMEOUT_S}", "-o", "faulthandler_timeout=7200"]
    command += of_pytest
    if _names_tests(of_pytest):
        status = subprocess.run(command, cwd=folder, env=environment).returncode
    else:
        command += in_processes(PER_CORE)
        suites = {folder: _tests(folder, kind)}
        if kind.tests == "all":
            suites[folder / "tools"] = ["tests"]
        status = max(
            subprocess.run(
                [*command, *_left_out(place, folder), *tests],
                cwd=place,
                env=environment,
            ).returncode
            for place, tests in suites.items()
        )
    found = summaries(reports)
    for text, count in found.most_common():
        print(f"{name}: {count} x {text}")
    print(f"{name}: {sum(found.values())} reports in {reports}, pytest ended with {status}")
    return status == 0 and not found


def prepared(name, reports):
    """Build; return the folder, and the environment of an interpreter that is to use it."""
    kind = KINDS[name]
    flags = " ".join(flag for flag in kind.cflags if flag.startswith("-fsanitize"))
    folder = build(name, cflags=kind.cflags, ldflags=(flags,), CC=_compiler())
    shutil.rmtree(reports, ignore_errors=True)
    reports.mkdir(parents=True)
    path = os.pathsep.join([str(folder), str(folder / "tools")])
    return folder, {**os.environ, **kind.environment(reports), "PYTHONPATH": path}


def reports_of(name):
    """The folder of what the runtimes report in a run, one file for each process."""
    return BUILDS / "reports" / name


def summaries(reports):
    """How often each finding was reported, by any process."""
    found = Counter()
    for report in sorted(reports.iterdir()):
        text = NO_FINDING.sub("", report.read_text(errors="replace"))
        lines = re.findall(r"^SUMMARY: (.*)$", text, re.MULTILINE)
        found.update(lines)
        if text.strip() and not lines:
            found[f"{report.name}: {text.strip().splitlines()[0]}"] += 1
    return found


def _names_tests(of_pytest):
    return any(argument.partition("::")[0].endswith(".py") for argument in of_pytest)


def _left_out(place, folder):
    """Options for pytest, which runs in a folder of the copy."""
    prefix = f"{place.relative_to(folder)}/".removeprefix("./")
    here = [test.removeprefix(prefix) for test in NOT_HERE if test.startswith(prefix)]
    return [f"--{'deselect' if '::' in test else 'ignore'}={test}" for test in here]


def _tests(folder, kind):
    if kind.tests == "threaded":
        patterns = [f"tests/{name}.py" for name in THREADED]
    else:
        patterns = [*CORE, "tests/*/test_*.py"]
    found = (path for pattern in patterns for path in sorted(folder.glob(pattern)))
    files = dict.fromkeys(path.relative_to(folder).as_posix() for path in found)
    # pytest --ignore of a folder lets the files in it pass that are named.
    return [file for file in files if not file.startswith(tuple(NOT_HERE))]


def _compiler():
    return "ccache gcc" if shutil.which("ccache") else "gcc"


def _runtime(library):
    found = subprocess.run(["gcc", f"-print-file-name={library}"], capture_output=True, text=True, check=True)
    path = Path(found.stdout.strip())
    if not path.is_absolute():
        raise SystemExit(f"gcc has no {library}; the packages libasan and libtsan have them")
    return str(path)


def _fixed_addresses():
    # Where the kernel places libraries at random, ThreadSanitizer may find one where its own memory must be.
    return ["setarch", "--addr-no-randomize"] if shutil.which("setarch") else []


if __name__ == "__main__":
    sys.exit(main())
