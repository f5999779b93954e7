"""The site of the documentation: it builds without warnings."""

import re
import sys

import pytest
from paths import ROOT
from processes import run

pytestmark = pytest.mark.ours


@pytest.mark.long("builds the site")
def test_it_builds_without_warnings(tmp_path):
    recipe = (ROOT / "Makefile").read_text(encoding="utf-8")
    [options] = re.findall(r"-m sphinx (.*) -d build/doctrees docs build/docs", recipe)
    command = [sys.executable, "-m", "sphinx", *options.split(), "-d", tmp_path / "trees"]
    ended = run(*command, ROOT / "docs", tmp_path)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")
