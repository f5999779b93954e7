# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of Sphinx for docs.ros.org: rosdoc2 copies this folder, with the pages that its links lead to.

The project is not built there, so the site has the pages without the reference of Python's names.
"""

import sys

# Sphinx reads this file in the folder of the copy.
sys.path.insert(0, "docs")
import pages_for_sphinx

extensions = []
# Last, rosdoc2's own copies of pages.
exclude_patterns = ["docs/api", "tools/docs/api", "standard_docs", "standards.rst", "__readme_include.rst"]
myst_heading_anchors = 4  # as git hosts make them
rosdoc2_settings = {"enable_autodoc": False}


def setup(app) -> None:
    app.connect("source-read", pages_for_sphinx.read_page)
