"""The site of the documentation: it builds without warnings."""

import re
import subprocess
import sys

import pytest
from paths import ROOT
from processes import DEADLINE_S

pytestmark = pytest.mark.ours


@pytest.mark.long("builds the site")
def test_it_builds_without_warnings(tmp_path):
    recipe = (ROOT / "Makefile").read_text(encoding="utf-8")
    [options] = re.findall(r"-m sphinx (.*) -d build/doctrees docs build/docs", recipe)
    command = [sys.executable, "-m", "sphinx", *options.split(), "-d", tmp_path / "trees"]
    ended = subprocess.run(
        [*command, ROOT / "docs", tmp_path], text=True, capture_output=True, timeout=6 * DEADLINE_S
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")
