# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where the files of the tools are."""

from pathlib import Path

TOOLS = Path(__file__).resolve().parents[2]
SUPPORT = TOOLS / "tests" / "support"
PROGRAMS = SUPPORT / "programs"
DOCS = TOOLS / "docs"
SAMPLES = DOCS / "samples"
