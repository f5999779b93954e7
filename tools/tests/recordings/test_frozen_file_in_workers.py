# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Workers share a frozen file: they need no memory for it, and find the same poses."""

import importlib.util
import json
import shutil
import statistics
from pathlib import Path

import pytest
from documentation_pages import named_programs
from processes import output_of
from tool_paths import DOCS, SAMPLES

COUNT, WORKERS = 400_000, 3
MB = 1_000_000


@pytest.mark.parametrize(
    "method", ["fork", "forkserver", "spawn", pytest.param("dask", marks=pytest.mark.long("needs Dask"))]
)
def test_workers_share_a_frozen_file(method):
    if method == "dask" and importlib.util.find_spec("distributed") is None:
        pytest.skip("needs distributed")
    found = json.loads(output_of(Path(__file__).with_name("measures_workers.py"), COUNT, WORKERS, method))
    assert found["file"] > 28 * MB
    small, frozen, loaded = (found[method][name] for name in ("small", "frozen", "loaded"))
    assert len({*frozen["totals"], *loaded["totals"]}) == 1

    def private(one):
        return statistics.median(one["private"]) - statistics.median(small["private"])

    assert private(frozen) < 5 * MB
    # A pickle of a buffer that was not frozen is a copy in each of them; a fork is not.
    assert method == "fork" or private(loaded) > 28 * MB
    # All together they have the file once.
    assert sum(frozen["pss"]) - sum(small["pss"]) < 1.1 * found["file"] + WORKERS * 5 * MB


def test_the_loader_of_the_page_hands_its_workers_the_same_poses(tmp_path):
    shutil.copytree(SAMPLES / "drive", tmp_path / "drive")
    program = tmp_path / "loader.py"
    code = named_programs(DOCS / "saved-buffers.md")["loader.py"]
    for method in ("spawn", "forkserver", "fork"):
        program.write_text(code.replace('get_context("spawn")', f'get_context("{method}")'), encoding="utf-8")
        assert output_of(program, cwd=tmp_path) == "10 (100, 7)\n"
    assert len([*(tmp_path / "cache").iterdir()]) == 1
