# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How the copyright and the license are written into a source."""

import sys

import pytest
from paths import ROOT

pytestmark = pytest.mark.ours

sys.path.insert(0, str(ROOT))
from release.license_headers import HASH, SLASHES, XML, header, style_of, with_header, without_header  # noqa: E402


@pytest.mark.parametrize(
    ("name", "first", "rest", "is_apart"),
    [
        ("a.py", "", '"""Facts."""\n', False),
        ("a.py", "#!/usr/bin/env python3\n", "import os\n", False),
        ("a.py", "#!/usr/bin/env python3\n# -*- coding: latin-1 -*-\n", "import os\n", False),
        ("a.py", "# coding=utf-8\n", "# A comment on what follows.\nimport os\n", True),
        ("a.pyx", "", "# cython: language_level=3\ncimport cython\n", True),
        ("a.pxi", "", "# A chapter.\n\ncdef int f(): ...\n", True),
        (".ci/run", "#!/usr/bin/env bash\n", "# What must pass.\nset -e\n", True),
        ("Makefile", "", "# make test\nall:\n", True),
        ("a.toml", "", "[project]\n", False),
        ("a.h", "", "#pragma once\n", True),
        ("a.c", "", "/* Facts. */\n", True),
        ("a.xml", '<?xml version="1.0"?>\n<?xml-model href="x"?>\n', "<package/>\n", False),
        ("a.xml", "", "<profiles/>\n", False),
    ],
)
def test_the_lines_come_first_but_for_what_must_stay_in_front(name, first, rest, is_apart):
    style = style_of(name)
    written = with_header(first + rest, style)
    assert written == first + header(style) + "\n" * is_apart + rest
    assert with_header(written, style) == written
    assert without_header(written, style) == first + rest


@pytest.mark.parametrize("style", [HASH, SLASHES, XML])
def test_an_empty_file_stays_empty(style):
    assert with_header("", style) == without_header("", style) == ""
    assert header(style).count("\n") == 2


@pytest.mark.parametrize("name", ["README.md", "a.svg", "a.msg", "LICENSE"])
def test_pages_and_data_have_no_header(name):
    assert style_of(name) is None
