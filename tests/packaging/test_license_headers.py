# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""reuse finds the copyright and the license of every file."""

import subprocess
import sys
from importlib.util import find_spec

import pytest
from paths import ROOT


@pytest.mark.long("needs reuse")
@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="this is not a clone")
@pytest.mark.skipif(find_spec("reuse") is None, reason="needs reuse")
def test_reuse_finds_copyright_and_license_of_every_file():
    ended = subprocess.run([sys.executable, "-m", "reuse", "lint"], cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stdout
