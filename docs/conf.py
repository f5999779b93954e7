"""Settings of Sphinx for the site that `make docs` builds of these pages.

The pages are plain Markdown, for git hosts, too. They link to files of the whole repository, so Sphinx
reads it from its root. The table of contents is made from the lists of docs/index.md.
"""

import os
import re
import sys
from pathlib import Path

import tf2_ros
import tf2_ros_tools

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
for package in (tf2_ros, tf2_ros_tools):
    if not Path(package.__file__).is_relative_to(ROOT):
        sys.exit(f"The reference would be that of {package.__file__}, outside {ROOT}: use `make docs`.")

project = "tf2-ros-cython"
author = copyright = "tf2-ros-cython authors"
version = release = tf2_ros.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc"]
root_doc = "docs/index"
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

LINK = re.compile(r"\[(?P<text>[^\]]*)\]\((?P<path>[^)\s#:]+)(?P<anchor>#[^)\s]*)?\)")
HEADING = re.compile(r"^## (?P<title>.*)$", re.MULTILINE)


def contents(text: str) -> str:
    """A hidden table of contents for each section of index.md: the pages that its list links to."""
    titles = list(HEADING.finditer(text))
    trees = []
    for title, following in zip(titles, [*titles[1:], None], strict=True):
        section = text[title.end() : following.start() if following else None]
        pages = [f"{found['text']} <{found['path'].rpartition('.')[0]}>" for found in LINK.finditer(section)]
        options = f":hidden:\n:caption: {title['title']}\n"
        trees.append("\n".join(["```{toctree}", options, *pages, "```"]))
    return "\n\n".join(trees)


def read_page(app, name: str, source: list[str]) -> None:
    """Make links to folders, and to Markdown that is not on the site, plain text; git hosts show these."""
    page = ROOT / f"{name}.md"
    if not page.exists():
        return  # not Markdown

    def on_site(found: re.Match[str]) -> str:
        target = (page.parent / found["path"]).resolve()
        document = target.relative_to(ROOT).with_suffix("").as_posix() if target.suffix == ".md" else None
        there = document in app.env.found_docs if document else not target.is_dir()
        return found[0] if there else found["text"]

    source[0] = LINK.sub(on_site, source[0])
    if name == root_doc:
        source[0] += "\n" + contents(source[0]) + "\n"


def setup(app) -> None:
    app.connect("source-read", read_page)
