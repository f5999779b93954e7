# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every source states its copyright and its license; reuse finds both for every other file."""

import subprocess
import sys
from importlib.util import find_spec

import pytest
from paths import ROOT

pytestmark = pytest.mark.ours
cloned = pytest.mark.skipif(not (ROOT / ".git").exists(), reason="this is not a clone")

sys.path.insert(0, str(ROOT))
from release.license_headers import (  # noqa: E402
    HASH,
    SLASHES,
    XML,
    header,
    sources,
    style_of,
    with_header,
    without_header,
)


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


@cloned
def test_every_source_has_the_header():
    texts = {path: (path.read_text(encoding="utf-8"), style) for path, style in sources()}
    assert len(texts) > 500
    lacking = [path for path, (text, style) in texts.items() if with_header(text, style) != text]
    assert lacking == [], "run python -m release.license_headers"


@cloned
@pytest.mark.skipif(find_spec("reuse") is None, reason="needs reuse")
def test_reuse_finds_copyright_and_license_of_every_file():
    ended = subprocess.run([sys.executable, "-m", "reuse", "lint"], cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stdout
