"""A short stress run."""

import subprocess
import sys

import pytest
from processes import DEADLINE_S

from reliability.domain import ROOT

pytestmark = pytest.mark.ours

SECONDS = 10


@pytest.mark.long("keeps all cores busy")
def test_all_that_uses_a_buffer_at_once_finds_it_whole():
    command = [sys.executable, "-m", "reliability.stress", "--minutes", str(SECONDS / 60)]
    process = subprocess.Popen(command, cwd=ROOT, text=True, stdout=subprocess.PIPE)
    try:
        said, _ = process.communicate(timeout=SECONDS + 8 * DEADLINE_S)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 0, said
    assert "passed" in said
