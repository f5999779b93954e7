# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every source states who holds its copyright, and its license; reuse finds both for every other file."""

import subprocess
import sys
from importlib.util import find_spec

import pytest
from paths import ROOT

pytestmark = [
    pytest.mark.ours,
    pytest.mark.skipif(not (ROOT / ".git").exists(), reason="this is not a clone"),
]

sys.path.insert(0, str(ROOT))
from release import license_headers  # noqa: E402


def test_every_source_has_the_header():
    texts = {path: (path.read_text(encoding="utf-8"), style) for path, style in license_headers.sources()}
    assert len(texts) > 500
    lacking = [
        path for path, (text, style) in texts.items() if license_headers.with_header(text, style) != text
    ]
    assert lacking == [], "run python -m release.license_headers"


@pytest.mark.skipif(find_spec("reuse") is None, reason="needs reuse")
def test_reuse_finds_copyright_and_license_of_every_file():
    ended = subprocess.run([sys.executable, "-m", "reuse", "lint"], cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stdout
