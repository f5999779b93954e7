# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
What Fast DDS logs while the tests run: not to the output of programs, which tests compare, but to a file.

A test that fails shows what was logged meanwhile.
"""

import os
from pathlib import Path

import pytest

# suite_plugin.py creates the folder, for each process of `pytest -n`; fastdds.xml names the variable.
LOG = Path(os.environ["ROS_LOG_DIR"], "fastdds.log")
os.environ["TF2_TEST_FASTDDS_LOG"] = str(LOG)

_begin = pytest.StashKey()  # the size of the log when the test began


def _size():
    return LOG.stat().st_size if LOG.exists() else 0


def pytest_runtest_setup(item):
    item.stash[_begin] = _size()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item):
    report = yield
    if report.failed and _size() > item.stash[_begin]:
        with LOG.open(errors="replace") as log:
            log.seek(item.stash[_begin])
            report.sections.append(("Log of Fast DDS", log.read()))
    return report
