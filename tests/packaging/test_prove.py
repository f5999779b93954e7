# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What `make prove` runs and writes, and what may change between a proof and a release."""

import subprocess
import sys

import pytest

from release import prove, release_check

PASSES = "print('== 3 passed, 1 skipped in 0.12s =='); print('ran with Python 3.12.3, rclpy 7.1.5')"
MANIFEST = (prove.ROOT / "package.xml").read_text()
FACTS = (prove.ROOT / "release" / "owner.toml").read_text()


@pytest.fixture
def repository(tmp_path):
    git(tmp_path, "init", "-q", "checkout")
    files = {".gitignore": "build\n", "a.py": "1", "CHANGELOG.md": "", "package.xml": MANIFEST}
    commit(tmp_path / "checkout", **files, **{str(prove.PAGE): "", "release/owner.toml": FACTS})
    return tmp_path / "checkout"


def git(folder, *words):
    return subprocess.check_output(["git", *words], cwd=folder, text=True).strip()


def commit(folder, **texts):
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    git(folder, "add", "-A")
    git(folder, "-c", "user.name=me", "-c", "user.email=me@example.org", "commit", "-q", "-m", "a change")
    return git(folder, "rev-parse", "HEAD")


def step(name, code=PASSES, **facts):
    return prove.Step(name, [sys.executable, "-c", code], **facts)


def test_an_interrupted_run_continues_in_another_clone_and_repeats_nothing(repository, tmp_path):
    interrupts = step("second", "import os, signal; os.kill(os.getppid(), signal.SIGINT)")
    with pytest.raises(KeyboardInterrupt):
        prove.main(None, [step("first"), interrupts], repository)
    proved, lines = prove.read_page(repository)
    assert (proved, [*lines]) == (git(repository, "rev-parse", "HEAD"), ["first"])
    facts = ["3", "0", "1", "Python 3.12.3, rclpy 7.1.5"]
    assert [lines["first"][name] for name in ("passed", "failed", "skipped", "versions")] == facts
    commit(repository, **{"CHANGELOG.md": "## 0.1.0"})
    git(tmp_path, "clone", "-q", repository, "another")
    assert prove.main(None, [step("first", "raise SystemExit(1)"), step("second")], tmp_path / "another") == 0
    assert prove.read_page(tmp_path / "another")[0] == proved
    # Another commit begins anew.
    other, reads = (
        commit(repository, **{"a.py": "2"}),
        step("one", f"assert open('a.py').read() == '2'; {PASSES}"),
    )
    assert prove.main(None, [reads], repository) == 0
    assert (prove.read_page(repository)[0], [*prove.read_page(repository)[1]]) == (other, ["one"])
    assert prove.main(proved, [reads], repository) == 1


OF_TWO_SUITES = "== 9 passed, 1 skipped in 2.5s ==\n== 1 failed, 2 passed, 2 errors in 60.2s (0:01:00) =="


@pytest.mark.parametrize(
    ("output", "status", "has_tests", "counts"),
    [
        (OF_TWO_SUITES, 2, True, (11, 3, 1)),
        ("2 passed in 1.00s", 2, True, (2, 1, 0)),
        ("== 12 skipped in 0.10s ==", 0, True, (0, 1, 12)),
        ("skipped: no tf2-0.46.0", 0, True, (0, 1, 0)),
        ("1 passed in a row", 0, False, (1, 0, 0)),
        ("", 1, False, (0, 1, 0)),
    ],
)
def test_a_step_in_which_no_test_passed_has_failed(output, status, has_tests, counts):
    assert tuple(prove.counts_of(step("one", has_tests=has_tests), output, status).values()) == counts


def test_a_release_says_what_was_not_run_and_changes_only_what_it_must(repository):
    steps = [step("one"), step("zenoh", lacks="there is no router")]
    assert prove.main(None, steps, repository) == 0
    said = "zenoh: not run, because there is no router"
    assert release_check.unproved(steps, repository) == [f"CHANGELOG.md does not say: {said}"]
    commit(repository, **{"CHANGELOG.md": said, "package.xml": MANIFEST.replace(">0.1.0<", ">0.2.0<")})
    assert release_check.unproved(steps, repository) == []
    assert release_check.unproved([step("two")], repository) == ["not proved: two; run make prove"]
    assert prove.main(None, [step("zenoh", "")], repository) == 1  # which is no longer lacking
    assert release_check.unproved([step("zenoh")], repository) == ["failed: zenoh"]
    commit(repository, **{"package.xml": MANIFEST.replace("<depend>", "<depend >"), "a.py": "2"})
    changed = release_check.unproved([], repository)
    assert [line.split(" has changed ")[0] for line in changed] == ["a.py", "package.xml"]
