# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What `make prove` runs, keeps and repeats, in a repository with steps of its own."""

import re
import subprocess
import sys

import pytest

from release import prove

RUNS_TESTS = "import sys; print('== 3 passed, 1 skipped in 0.12s =='); print('2 passed in 0.01s')"


def step(name, code, *reads):
    return prove.Step(name, (sys.executable, "-c", code), reads)


@pytest.fixture
def repository(tmp_path):
    for name in ("core/a.py", "tools/b.py", "docs/development/proofs.md", "release/c.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("1\n")
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
    page = (repository / prove.PAGE).read_text()
    assert "| tests | " in page and "| 5 | 0 | 1 | " in page and f"| {result['commit']} | " in page
    assert prove.counts_of("=== 1 failed, 2 passed, 3 errors in 1.00s ===", 1)["failed"] == 4
    # Such as a session that ends before its last line.
    assert prove.counts_of("2 passed in 1.00s", 2)["failed"] == 1


def test_a_proof_has_a_commit(repository, capsys):
    (repository / "core" / "a.py").write_text("not committed")
    with pytest.raises(SystemExit):
        prove.main([], [step("one", "1", "*")], repository)
    assert "commit first, because a proof has a commit: core/a.py" in capsys.readouterr().err


def test_what_a_machine_lacks_is_not_due_and_a_row_says_so(repository):
    lacking = prove.Step("zenoh", ("false",), ("*",), "no router")
    assert proved(repository, [lacking, step("one", "1", "*")]) == (0, ["one"])
    assert "| zenoh | `false` | not had: no router |" in (repository / prove.PAGE).read_text()


def targets_of(makefile):
    heads = re.findall(r"^([a-z][a-z -]*):(?!=)", makefile.read_text(encoding="utf-8"), re.MULTILINE)
    return {target for head in heads for target in head.split()}


@pytest.mark.skipif(not (prove.ROOT / ".git").exists(), reason="this is not a clone")
def test_each_step_runs_a_command_of_make_and_reads_tracked_files():
    found, tracked = list(prove.steps()), prove.tracked_files()
    assert len({one.name for one in found}) == len(found) > 20
    for one in found:
        program, *words = one.command
        assert program in ("make", "env")
        if program == "make":
            folder = prove.ROOT / (words[1] if words[0] == "-C" else "")
            assert words[-1 if words[0] == "-C" else 0] in targets_of(folder / "Makefile"), one.command
        read = {name for name in tracked if prove.hash_of(one, {name: "1"}) != prove.hash_of(one, {})}
        assert "tf2_ros/buffer.py" in read and str(prove.PAGE) not in read
        for pattern in one.reads:
            assert any(prove.fnmatchcase(name, pattern) for name in tracked), pattern
    of = {one.name: one for one in found}
    tools = {"tools/tf2_ros_tools/bag.py": "1"}
    assert prove.hash_of(of["core, all tests"], tools) == prove.hash_of(of["core, all tests"], {})
