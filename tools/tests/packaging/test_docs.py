# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The documentation of the tools, and the programs on all pages; and the site, which has both parts."""

import ast
import importlib
import re
import signal
import subprocess
import sys
from contextlib import nullcontext

import pytest
from documentation_pages import (
    check_blocks,
    check_links,
    commands_and_spans,
    named_files,
    named_programs,
    names_of,
    program,
    programs_beside,
)
from paths import ROOT
from processes import killed, run
from project_sources import words_of_sources
from starting_programs import ended, heard
from tool_pages import ALL_PAGES, PAGES, provide_torch, run_program
from tool_paths import DOCS, TOOLS
from tool_project import PACKAGES, PYPROJECT
from waiting import DEADLINE_S

by_name = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


@by_name
def test_every_block_is_found(page):
    check_blocks(page)


@by_name
def test_links_lead_somewhere(page):
    check_links(page)


# Programs: in a process of their own, with rclpy, on the ROS domain of this test run.

GETTING_STARTED = ROOT / "docs" / "getting-started.md"  # live.md needs its robot, too


def with_a_program():
    """The pages that have one."""
    whys = {"datasets.md": "needs pyarrow"}
    for page in filter(program, PAGES):
        marks = [pytest.mark.long(whys[page.name])] if page.name in whys else []
        yield pytest.param(page, id=page.name, marks=marks)


@pytest.mark.parametrize("page", [*with_a_program()])
def test_the_programs_of_a_page_run_and_print_what_it_says(page, tmp_path):
    if page.name == "live.md":
        pytest.importorskip("cyclonedds")
    if page.name == "datasets.md":
        pytest.importorskip("pyarrow")
        provide_torch(tmp_path)
    with programs_beside(GETTING_STARTED, tmp_path) if page.name == "live.md" else nullcontext():
        run_program(page, tmp_path)


@pytest.mark.long("waits for discovery, twice")
@pytest.mark.parametrize("line", ["view_frames --text", "tf2_echo map camera"])
def test_the_programs_show_the_first_robot_as_the_page_says(line, tmp_path):
    text = GETTING_STARTED.read_text(encoding="utf-8")
    [shown] = re.findall(rf"^```sh\n{line}\n```\n\n```text\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    name, *arguments = line.split()
    if name == "tf2_echo":
        arguments, how = [*arguments, "--once", "--wait", str(DEADLINE_S)], {}
    else:
        how = {"hears": heard("camera", base_link=10)}
    with programs_beside(GETTING_STARTED, tmp_path):
        _, printed, _ = ended(name, *arguments, **how, cwd=tmp_path)
    signed = re.compile(r"-?\d+")
    assert signed.sub("#", printed).startswith(signed.sub("#", shown.removesuffix("…\n")))


def test_the_recorder_saves_what_it_received_until_ctrl_c(tmp_path, peer):
    code = named_programs(DOCS / "recordings.md")["record.py"]
    # It says when it has received everything: interrupted before that, there might be nothing to save.
    received = 'print(buffer.can_transform("map", "camera", 1_000_000_000, timeout=60), flush=True)'
    # A signal that comes just before a sleep begins does not interrupt it, and is noticed at its end.
    sleeps = "for _ in range(600):\n            time.sleep(0.1)"
    code = code.replace("        time.sleep(60)", f"        {received}\n        {sleeps}")
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with killed(subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, text=True, **pipes)) as recorder:
        assert recorder.stdout.readline() == "Recording for 60 s, or until Ctrl-C\n"
        robot = peer()
        robot.send(("base_link", "camera", 0, 0.5), static=True)
        robot.send(("map", "base_link", 1_000_000_000, 1.0))
        assert recorder.stdout.readline() == "True\n"
        recorder.send_signal(signal.SIGINT)
        _, errors = recorder.communicate(timeout=DEADLINE_S)
    assert (recorder.returncode, errors) == (0, "")
    buffer = importlib.import_module("tf2_ros_tools.bag").load(tmp_path / "live.mcap")
    assert buffer.lookup_transform("map", "camera", 1_000_000_000).transform.translation.x == 1.5


# Commands: those in blocks, and those in the text.

PROGRAMS = set(PYPROJECT["project"]["scripts"])
EXTRAS = {"", *PYPROJECT["project"]["optional-dependencies"]}
MAKEFILE = (TOOLS / "Makefile").read_text(encoding="utf-8")
FILES = named_files(PAGES)


@pytest.mark.parametrize("page", ALL_PAGES, ids=lambda page: page.name)
def test_the_commands_of_a_page_name_options_targets_and_extras_that_exist(page):
    for words in commands_and_spans(page):
        match words[3:] if words[:3] == ["ros2", "run", "tf2_ros_tools"] else words:
            case [name, *arguments] if name in PROGRAMS:
                module = importlib.import_module(f"tf2_ros_tools.programs.{name}")
                module.PARSER.read([name, *arguments])
            case ["make", "-C", "tools", target, *_]:
                assert re.search(rf"^[a-z ]*\b{target}\b[a-z ]*:", MAKEFILE, re.MULTILINE), words
            case ["pip", "install", *wanted]:
                ours = [one for one in wanted if "tools" in one]
                named = [extra for one in ours for extra in re.findall(r"\[(.+)\]", one)]
                assert {extra for extras in named for extra in extras.split(",")} <= EXTRAS, words
            case ["python", path, *_] if page in PAGES and not path.startswith("-"):
                assert (ROOT / path).is_file() or path in FILES, words


IMAGE = re.compile(r"!\[([^\]]*)\]\(\S*?([\w-]+\.(?:svg|png))\)")
PICTURES = ast.literal_eval(
    re.search(r"^PICTURES = ({.*?^})", (DOCS / "pictures.py").read_text(encoding="utf-8"), re.M | re.S)[1]
)
SHOWN = [
    pytest.param(page, found[1], found[2], found.start(), id=f"{page.name}-{found[2]}")
    for page in ALL_PAGES
    for found in IMAGE.finditer(page.read_text(encoding="utf-8"))
    if found[2] in PICTURES and page.name != "README.md"  # which shows a picture without its command
]


@pytest.mark.parametrize(("page", "caption", "picture", "place"), SHOWN)
def test_a_picture_is_that_of_the_command_before_it(page, caption, picture, place):
    name = PICTURES[picture].split()[0]
    before = page.read_text(encoding="utf-8")[:place]
    *_, command = re.findall(rf"^{name}\b.*$|(?<=`){name} [^`\n]+(?=`)", before, re.MULTILINE)
    assert command.partition("  #")[0].rstrip() == PICTURES[picture]
    # The frames of the command are in the caption, and those of the caption in the picture, if it has text.
    frames = [word for word in PICTURES[picture].split() if word in ("map", "odom", "base_link", "camera")]
    assert all(frame in caption for frame in frames) or name == "tf2_monitor"
    if picture.endswith("-tree.svg"):
        [link] = re.findall(rf"\((\S*{picture})\)", page.read_text(encoding="utf-8"))
        drawn = (page.parent / link).read_text(encoding="utf-8")
        assert all(
            f">{frame}<" in drawn for frame in re.findall(r"\b(?:map|odom|base_link|camera)\b", caption)
        )


INTERNALS = DOCS / "development" / "internals.md"


@pytest.mark.parametrize("name", names_of(INTERNALS))
def test_a_name_in_the_internals_exists(name):
    known = words_of_sources(TOOLS, PACKAGES) | words_of_sources()
    name = re.sub(r"\(.*\)$|=.*$", "", name)
    is_path = any((folder / name).exists() for folder in (TOOLS, TOOLS / "tf2_ros_tools"))
    assert is_path or set(re.findall(r"\w+", name)) <= known


@pytest.mark.long("builds the site")
def test_the_site_builds_without_warnings(tmp_path):
    pytest.importorskip("furo")  # of the extra docs; Sphinx itself also comes with rosdoc2
    recipe = (ROOT / "Makefile").read_text(encoding="utf-8")
    [options] = re.findall(r"-m sphinx (.*) -d build/doctrees -c docs . build/docs", recipe)
    site = tmp_path / "site"
    command = [
        sys.executable,
        "-m",
        "sphinx",
        *options.split(),
        "-d",
        tmp_path / "trees",
        "-c",
        ROOT / "docs",
    ]
    done = run(*command, ROOT, site)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    [start] = re.findall(r'url=([^"]+)', (site / "index.html").read_text(encoding="utf-8"))
    assert "tools/docs/programs/tf2_check.html" in (site / start).read_text(encoding="utf-8")
