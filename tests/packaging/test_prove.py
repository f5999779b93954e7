# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What `make prove` runs, keeps and repeats, in a repository with steps of its own."""

import re
import subprocess
import sys

import pytest

from release import proof_pages, prove

RUNS_TESTS = "import sys; print('== 3 passed, 1 skipped in 0.12s =='); print('2 passed in 0.01s')"
MARKED = "Measured: <!-- proved: coverage, by make prove -->?<!-- end -->.\n"


def step(name, code, *reads):
    return prove.Step(name, (sys.executable, "-c", code), reads)


@pytest.fixture
def repository(tmp_path):
    for name in ("core/a.py", "tools/b.py", "release/c.py", *proof_pages.MARKED_PAGES):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(MARKED if name.endswith(".md") else "1\n")
    (tmp_path / ".gitignore").write_text("build\n")
    git(tmp_path, "init", "-q")
    commit(tmp_path)
    return tmp_path


def git(folder, *words):
    options = ("-c", "user.name=me", "-c", "user.email=me@example.org")
    subprocess.run(["git", *options, *words], cwd=folder, check=True, capture_output=True)


def commit(folder, **changed):
    for name, text in changed.items():
        (folder / name.replace("__", "/")).with_suffix(".py").write_text(text)
    git(folder, "add", "-A")
    git(folder, "commit", "-q", "-m", "a change", "--allow-empty")


def proved(folder, found, *options):
    """The status, and the names of the steps that ran."""
    before = {name: dict(result) for name, result in prove.results(folder).items()}
    status = prove.main(options, found, folder)
    after = prove.results(folder)
    return status, [one.name for one in found if after.get(one.name) != before.get(one.name)]


def test_a_step_runs_again_only_if_a_file_that_it_reads_has_changed(repository):
    # The time of day, so that the results of two runs differ.
    code = "import pathlib, time; pathlib.Path('build/ran').open('a').write('x')"
    found = [step("core", code, "core/*"), step("all", code, "*")]
    ran = repository / "build" / "ran"
    assert proved(repository, found) == (0, ["core", "all"])
    assert prove.main([], found, repository) == 0 and ran.read_text() == "xx"
    commit(repository)  # what the run has written
    assert prove.main([], found, repository) == 0 and ran.read_text() == "xx"
    commit(repository, tools__b="2")
    assert prove.main([], found, repository) == 0 and ran.read_text() == "xxx"
    commit(repository, core__a="2")
    assert prove.main(["--only", "core"], found, repository) == 0 and ran.read_text() == "xxxx"
    assert [
        one.name for one in prove.due(found, prove.results(repository), prove.tracked_files(repository))
    ] == ["all"]


def test_another_command_is_due(repository):
    assert proved(repository, [step("one", "1", "*")]) == (0, ["one"])
    assert proved(repository, [step("one", "2", "*")]) == (0, ["one"])


def test_a_step_does_not_get_the_options_of_make_prove(repository, monkeypatch):
    monkeypatch.setenv("MAKEFLAGS", " -- OPTIONS=--only\\ one")
    found = [step("one", "import os; raise SystemExit('MAKEFLAGS' in os.environ)", "*")]
    assert proved(repository, found) == (0, ["one"])


def test_what_failed_stays_due(repository):
    found = [step("red", "raise SystemExit(3)", "*"), step("green", "1", "*")]
    assert proved(repository, found) == (1, ["red", "green"])
    kept = prove.results(repository)
    assert [kept[name]["failed"] for name in ("red", "green")] == [1, 0]
    assert [one.name for one in prove.due(found, kept, prove.tracked_files(repository))] == ["red"]


def test_tests_are_counted(repository):
    proved(repository, [step("tests", RUNS_TESTS, "*")])
    result = prove.results(repository)["tests"]
    assert (result["passed"], result["failed"], result["skipped"]) == (5, 0, 1)
    page = (repository / proof_pages.PAGE).read_text()
    assert "| tests | " in page and "| 5 | 0 | 1 | " in page and f"| {result['commit']} | " in page


TWO_SUITES = """\
make[1]: Entering directory '/clone'
.venv/bin/python -m pytest --numprocesses=4
====== 5021 passed, 12 skipped, 1 warning in 241.53s (0:04:01) ======
make -C tools test
== 1 failed, 902 passed, 3 skipped, 2 deselected, 1 xfailed, 2 errors in 60.20s (0:01:00) ==
"""
OF_RELEASES = """\
SKIPPED [1] tests/ros/test_waits.py:12: 1 passed in a row
486 passed, 38 skipped in 58.70s
tf2-0.36.20-cp311: passed
"""
OF_FUZZING = """\
cdr: 120401 executions, 5120 edges, 600 s, nothing found
clouds: 3 executions, 51 edges, 2 s, crash-0a1b2c
"""
OF_STRESS = "12 clears, 3 failed waits\nrss          1,024 1,030\npassed, seed 1\n"


@pytest.mark.parametrize(
    ("output", "status", "counted"),
    [
        (TWO_SUITES, 2, (5923, 3, 15)),
        (OF_RELEASES, 0, (486, 0, 38)),
        (OF_FUZZING, 1, (0, 1, 0)),
        (OF_STRESS, 0, (1, 0, 0)),
        # Such as a session that ends before its last line, and a demo that fails after the tests.
        ("2 passed in 1.00s\n", 2, (2, 1, 0)),
    ],
)
def test_counts_are_those_of_all_summaries_of_pytest(output, status, counted):
    assert tuple(prove.counts_of(output, status).values()) == counted


def test_a_proof_has_a_commit(repository, capsys):
    (repository / "core" / "a.py").write_text("not committed")
    with pytest.raises(SystemExit):
        prove.main([], [step("one", "1", "*")], repository)
    assert "commit first, because a proof has a commit: core/a.py" in capsys.readouterr().err


def test_the_commit_of_a_proof_is_that_at_its_begin(repository):
    moves = (
        "import subprocess; subprocess.run(['git', '-c', 'user.name=me', '-c', 'user.email=me@example.org',"
    )
    moves += " 'commit', '-q', '--allow-empty', '-m', 'another'], check=True)"
    head = ["git", "rev-parse", "--short=8", "HEAD"]
    before = subprocess.check_output(head, cwd=repository, text=True).strip()
    assert prove.main([], [step("one", moves, "*")], repository) == 0
    assert prove.results(repository)["one"]["commit"] == before
    assert subprocess.check_output(head, cwd=repository, text=True).strip() != before


def test_what_a_machine_lacks_is_not_due_and_a_row_says_so(repository):
    lacking = prove.Step("zenoh", ("false",), ("*",), "no router")
    assert proved(repository, [lacking, step("one", "1", "*")])[0] == 0
    assert prove.results(repository)["zenoh"] == {"lacks": "no router"}
    assert "| zenoh | `false` | not had: no router |" in (repository / proof_pages.PAGE).read_text()
    # Where it is not lacking, it is due.
    assert proved(repository, [prove.Step("zenoh", ("true",), ("*",))]) == (0, ["zenoh"])


def test_a_result_stays_where_it_cannot_be_had_only_for_the_same_files(repository):
    here, elsewhere = (prove.Step("zenoh", ("true",), ("core/*",), lacks) for lacks in ("", "no router"))
    assert proved(repository, [here]) == (0, ["zenoh"])
    assert proved(repository, [elsewhere]) == (0, [])
    commit(repository, core__a="2")
    assert proved(repository, [elsewhere]) == (0, ["zenoh"])
    assert prove.results(repository)["zenoh"] == {"lacks": "no router"}


COVERAGE = "print('Python: 7 of 10 lines, 70.0 %'); print('Cython: 1,100 of 1,200 lines, 91.7 %')"


def test_a_marked_place_says_what_was_measured_and_is_no_reason_to_repeat_a_step(repository):
    found = [step("coverage", COVERAGE, "*")]
    assert proved(repository, found) == (0, ["coverage"])
    result = prove.results(repository)["coverage"]
    [text] = {(repository / name).read_text() for name in proof_pages.MARKED_PAGES}
    assert "1,100 of 1,200 lines, 91.7 %, of Cython" in text and f"commit {result['commit']}, " in text
    commit(repository)
    assert proved(repository, found) == (0, [])
    (repository / "QUALITY_DECLARATION.md").write_text(f"Another sentence. {MARKED}")
    commit(repository)
    assert proved(repository, found) == (0, ["coverage"])


def test_a_marked_page_that_is_changed_elsewhere_is_not_committed(repository, capsys):
    (repository / "QUALITY_DECLARATION.md").write_text(f"Another sentence. {MARKED}")
    with pytest.raises(SystemExit):
        prove.main([], [step("one", "1", "*")], repository)
    assert "commit first, because a proof has a commit: QUALITY_DECLARATION.md" in capsys.readouterr().err


def test_pages_claim_only_what_the_kept_results_say():
    kept = prove.results()
    page = (prove.ROOT / proof_pages.PAGE).read_text(encoding="utf-8")
    assert page == proof_pages.page(list(prove.steps()), kept)
    texts = [(prove.ROOT / name).read_text(encoding="utf-8") for name in proof_pages.MARKED_PAGES]
    assert [proof_pages.with_proofs(text, kept) for text in texts] == texts
    assert {name for text in texts for _, name, _ in proof_pages.PLACE.findall(text)} == {*proof_pages.PROVED}


def targets_of(makefile):
    heads = re.findall(r"^([a-z][a-z -]*):(?!=)", makefile.read_text(encoding="utf-8"), re.MULTILINE)
    return {target for head in heads for target in head.split()}


@pytest.mark.skipif(not (prove.ROOT / ".git").exists(), reason="this is not a clone")
def test_each_step_runs_a_command_of_make_and_reads_tracked_files():
    found, tracked = list(prove.steps()), prove.tracked_files()
    assert len({one.name for one in found}) == len(found) > 20
    for one in found:
        program, *words = one.command
        assert program == "make"
        folder = prove.ROOT / (words[1] if words[0] == "-C" else "")
        assert words[-1 if words[0] == "-C" else 0] in targets_of(folder / "Makefile"), one.command
        read = {name for name in tracked if prove.hash_of(one, {name: "1"}) != prove.hash_of(one, {})}
        assert "tf2_ros/buffer.py" in read and str(proof_pages.PAGE) not in read
        for pattern in one.reads:
            assert any(prove.fnmatchcase(name, pattern) for name in tracked), pattern
    of = {one.name: one for one in found}
    tools = {"tools/tf2_ros_tools/bag.py": "1"}
    assert prove.hash_of(of["core, all tests"], tools) == prove.hash_of(of["core, all tests"], {})
