# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of Sphinx for the site that `make docs` builds of these pages.

The pages link to files of the whole repository, so Sphinx reads it from its root.
"""

import os
import sys
from pathlib import Path

import tf2_ros
import tf2_ros_tools

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path.insert(0, str(HERE))
import pages_for_sphinx  # noqa: E402

for package in (tf2_ros, tf2_ros_tools):
    if not Path(package.__file__).is_relative_to(ROOT):
        sys.exit(f"The reference would be that of {package.__file__}, outside {ROOT}: use `make docs`.")

project = "tf2-ros-cython"
author = copyright = "tf2-ros-cython authors"
version = release = tf2_ros.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc"]
root_doc = pages_for_sphinx.INDEX
include_patterns = [
    "*.md",
    "docs/**.md",
    "docs/**.rst",
    "tools/*.md",
    "tools/docs/**.md",
    "tools/docs/**.rst",
]
# Sphinx looks for pages in all other folders.
exclude_patterns = [".*", "build", "dist"]
myst_heading_anchors = 4  # as git hosts make them

html_theme = "furo"
html_title = project
html_copy_source = False
html_static_path = ["static"]
html_css_files = ["site.css"]
html_extra_path = ["site"]  # leads from the root of the site to docs/index.html

# The reference. The docstrings say what a function takes and returns; tf2_py.rst explains the types.
autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_inherit_docstrings = True
# The compiled modules are documented, and imported, instead of their stubs.
os.environ["SPHINX_AUTODOC_IGNORE_NATIVE_MODULE_TYPE_STUBS"] = "1"
python_maximum_signature_line_length = 90

# A reference to a name that is not on the site is a warning.
nitpicky = True


def setup(app) -> None:
    app.connect("source-read", pages_for_sphinx.read_page)
