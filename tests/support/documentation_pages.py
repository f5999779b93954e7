# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The pages of the documentation: their blocks of code, and running their programs."""

import re
import shlex
import subprocess
import sys
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import pairwise
from textwrap import dedent

import pytest
from paths import ROOT
from processes import run
from waiting import DEADLINE_S

PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "SECURITY.md",
    ROOT / "QUALITY_DECLARATION.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]

# In a list, a block is indented.
FENCE = re.compile(
    r"^(?P<indent> *)```(?P<language>\w*)\n(?P<code>.*?)^(?P=indent)```$", re.MULTILINE | re.DOTALL
)
SPAN = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
LINK = re.compile(r"\]\(([^)\s]+)\)")
HEADING = re.compile(r"^#+ +(.*)$", re.MULTILINE)

RUN = "python"  # all blocks of a page, one after the other, in one process; but see FILE
# The first line of a block that is a program of its own: pytest runs test_*.py, others run beside the page's.
FILE = re.compile(r"# (\w+\.py)\n")
CHECKED = "sh"  # commands: their options, targets and extras
SHOWN = {"text"}  # diagrams and output; where it follows a Python block, the program prints it


@dataclass(frozen=True)
class Block:
    language: str
    code: str
    line: int  # of its first line of code


def blocks(page):
    text = page.read_text(encoding="utf-8")
    for found in FENCE.finditer(text):
        yield Block(found["language"], dedent(found["code"]), text.count("\n", 0, found.start()) + 2)


def commands(page, *more):
    """The command lines in the blocks of a page, and more: the variables that each sets, and its words."""
    lines = [line for block in blocks(page) if block.language == CHECKED for line in block.code.splitlines()]
    for line in [*lines, *more]:
        try:
            words = shlex.split(line, comments=True)
        except ValueError:
            continue  # a span that is no command
        variables = {}
        while words and re.fullmatch(r"[A-Z0-9_]+=.*", words[0]):
            name, _, variables[name] = words.pop(0).partition("=")
        yield variables, words


def prose(page):
    return FENCE.sub("", page.read_text(encoding="utf-8"))


def named_programs(page):
    """The blocks of a page that are programs of their own, by name."""
    found = ((FILE.match(block.code), block.code) for block in blocks(page) if block.language == RUN)
    return {name[1]: code for name, code in found if name}


def named_files(pages):
    """The files that readers of pages write, and that the tests run."""
    return {name for page in pages for name in named_programs(page)}


def program(page):
    """The Python blocks of a page, on the lines that they have there."""
    lines = []
    for block in blocks(page):
        if block.language == RUN and not FILE.match(block.code):
            lines += [""] * (block.line - 1 - len(lines))
            lines += block.code.splitlines()
    return "\n".join(lines)


LIBRARIES = {"pandas": r"^import pandas", "scipy": r"^from scipy"}


def libraries_of(page):
    """The libraries that the program of a page needs, of those that `make test` does not install."""
    return [name for name, use in LIBRARIES.items() if re.search(use, program(page), re.MULTILINE)]


def patient(code):
    """The same program, whose waits for other nodes last as long as a busy machine may need."""
    longer = rf"\g<1>{DEADLINE_S:g}"
    return re.sub(r"(\btimeout=(?:Duration\(seconds=)?)(?:5|10|15)(?:\.0)?\b", longer, code)


def run_program(page, folder, python=sys.executable, environment=None):
    """Run the program of a page in a folder; it must print what the page says."""
    for library in libraries_of(page):
        pytest.importorskip(library)
    path = folder / page.name
    path.write_text(patient(program(page)), encoding="utf-8")
    with programs_beside(page, folder):
        ended = run(python, path, cwd=folder, env=environment)
    assert ended.returncode == 0, ended.stderr
    printed = iter(ended.stdout.splitlines())
    for said in re.findall(r"^print\(.*  # (.*)$", program(page), re.MULTILINE):
        # An ellipsis says that the line goes on.
        assert any(said.rstrip(" …") in line for line in printed), f"{said!r} is not in {ended.stdout!r}"
    written = [without_numbers(line) for line in (ended.stdout + ended.stderr).splitlines()]
    for line in output(page):
        assert any(without_numbers(line) in one for one in written), f"{line!r} is not in {written!r}"


@contextmanager
def programs_beside(page, folder):
    """The programs of a page that have a name run meanwhile, except those that start processes."""
    with ExitStack() as started:
        for name, code in named_programs(page).items():
            if name.startswith("test_") or "__main__" in code:
                continue
            path = folder / name
            path.write_text(patient(code), encoding="utf-8")
            beside = started.enter_context(subprocess.Popen([sys.executable, path], cwd=folder))
            started.callback(beside.kill)
        yield


def output(page):
    """The lines of the text blocks that directly follow a Python block of the page's program."""
    found = [*FENCE.finditer(page.read_text(encoding="utf-8"))]
    for before, block in pairwise(found):
        between = page.read_text(encoding="utf-8")[before.end() : block.start()]
        if before["language"] == RUN and block["language"] in SHOWN and not between.strip():
            yield from dedent(block["code"]).splitlines()


def without_numbers(line):
    return re.sub(r"\d+", "#", line)


# What holds of each page.


def check_blocks(page):
    """Every block is found."""
    opened = re.findall(r"^ *```", page.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(opened) == 2 * len(list(blocks(page)))


def check_links(page):
    """Links lead somewhere."""
    for link in LINK.findall(prose(page)):
        if link.startswith("https://"):
            continue  # no test asks another machine
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists(), link
        assert not anchor or anchor in _anchors(target), link


def linked_pages(page):
    """The files that a page links to."""
    paths = (link.partition("#")[0] for link in LINK.findall(prose(page)) if not link.startswith("https://"))
    return {(page.parent / path).resolve() for path in paths if path}


def _anchors(page):
    headings = HEADING.findall(prose(page))
    return {re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-") for heading in headings}


def commands_and_spans(page):
    """The words of each command in a block, and of each text that is written as code and may be a command."""
    for _, words in commands(page, *(span for span in SPAN.findall(prose(page)) if " " in span)):
        yield words


def names_of(page):
    """What is written as code, and what looks like a name in a diagram."""
    diagrams = "\n".join(block.code for block in blocks(page) if block.language in SHOWN)
    words = re.findall(r"(?<![/\w.])[A-Za-z_][\w.]*\w", diagrams)
    # The table of packages is test_import_directions.py's.
    text = re.sub(r"^\| package \|.*?(?=\n\n)", "", prose(page), flags=re.MULTILINE | re.DOTALL)
    spans = [span for span in SPAN.findall(text) if " " not in span]
    return sorted({*spans, *(word for word in words if re.search(r"[_.]|[a-z][A-Z]", word))})
