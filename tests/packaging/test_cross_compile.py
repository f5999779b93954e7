# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The extensions compile for 64-bit ARM; `make cross` also runs tests on an emulated one."""

import sys

import pytest
from paths import ROOT

pytestmark = pytest.mark.long("fetches a compiler")

sys.path.insert(0, str(ROOT))
from release import cross_compile  # noqa: E402


def test_the_extensions_compile():
    try:
        tools = cross_compile.fetch_tools()
    except cross_compile.Unavailable as error:
        pytest.skip(str(error))
    _, errors = cross_compile.build(tools, "-O0")
    assert errors == {}
