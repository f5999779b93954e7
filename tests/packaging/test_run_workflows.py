# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How the jobs of GitHub workflows are run here; none of them is."""

import subprocess
import sys

import pytest
from paths import ROOT

pytestmark = pytest.mark.ours

sys.path.insert(0, str(ROOT))
from release import run_workflows  # noqa: E402

WORKFLOW = """
jobs:
  join:
    needs: make
    runs-on: ubuntu-24.04
    steps:
      - uses: actions/checkout@v7
      - uses: actions/download-artifact@v7
        with: {pattern: words-*, path: got, merge-multiple: true}
      - run: test "$(cat got/in/*.txt)" = "$(printf 'one\\ntwo')"
      - run: test -f tracked.txt && test "$PLACE" = "${{ github.workspace }}"
        env: {PLACE: "${{ github.workspace }}"}
      - run: test "$(pwd)" = "$GITHUB_WORKSPACE/got"
        working-directory: got
  make:
    runs-on: ubuntu-24.04
    strategy:
      matrix:
        word: [one]
        include: [{word: two}]
    steps:
      - run: mkdir -p made/in && echo ${{ matrix.word }} > made/in/${{ matrix.word }}.txt
      - uses: actions/upload-artifact@v7
        with: {name: "words-${{ matrix.word }}", path: made/**/*.txt}
  fails:
    runs-on: ubuntu-24.04
    steps:
      - run: "true"
      - name: Stops at the first command that fails
        run: |
          false
          exit 0
      - run: exit 1
  pipes:
    runs-on: ubuntu-24.04
    steps: [{run: "false | true"}]
  elsewhere:
    runs-on: macos-14
    steps: [{run: "true"}]
  boxed:
    runs-on: ubuntu-24.04
    container: ros:jazzy
    steps: [{run: "true"}]
  others:
    runs-on: ubuntu-24.04
    steps: [{uses: pypa/cibuildwheel@v4}]
  unknown:
    runs-on: ubuntu-24.04
    steps: [{run: "echo ${{ secrets.TOKEN }}"}]
"""


def test_the_jobs_run_in_order_and_what_cannot_run_is_named(tmp_path):
    (tmp_path / "tracked.txt").touch()
    for command in (["init"], ["add", "."], [*"-c user.name=t -c user.email=t@t commit -m t".split()]):
        subprocess.run(["git", *command], cwd=tmp_path, check=True, capture_output=True)
    (tmp_path / "flow.yml").write_text(WORKFLOW)
    jobs = run_workflows.jobs_of(tmp_path / "flow.yml")
    found = run_workflows.run(jobs, tmp_path)
    results = {
        str(job).removeprefix("flow.yml "): result.partition(" after ")[0] for job, result in found.items()
    }
    assert results == {
        "make (one)": "passed",
        "make (two)": "passed",
        "join": "passed",
        "fails": "failed at 'Stops at the first command that fails'",
        "pipes": "failed at 'false | true'",
        "elsewhere": "not run: needs a machine with macos-14",
        "boxed": "not run: needs container ros:jazzy",
        "others": "not run: needs the action pypa/cibuildwheel",
        "unknown": "not run: needs a value for secrets.TOKEN",
    }


def test_every_job_of_the_workflows_has_a_name_of_its_own():
    jobs = [
        job for path in (ROOT / ".github" / "workflows").glob("*.yml") for job in run_workflows.jobs_of(path)
    ]
    names = {str(job) for job in jobs}
    assert {"ci.yml core", "ci.yml pypi (3.11, .ci/run)", "wheels.yml stubs", "wheels.yml publish"} <= names
    assert len(names) == len(jobs)
