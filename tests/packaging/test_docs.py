"""The documentation: its programs run, its commands work, its links lead somewhere, its names exist."""

import importlib
import re
import signal
import subprocess
import sys

import pytest
from pages import (
    FILES,
    HEADING,
    LINK,
    PAGES,
    SHOWN,
    SPAN,
    blocks,
    commands,
    named_programs,
    program,
    programs_beside,
    prose,
    provide_torch,
    run_program,
)
from paths import ROOT
from processes import DEADLINE_S, killed, output_of, run
from sources import PYPROJECT, words_of_sources

pytestmark = pytest.mark.ours

by_name = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


@by_name
def test_every_block_is_found(page):
    opened = re.findall(r"^ *```", page.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(opened) == 2 * len(list(blocks(page)))


# Programs: in a process of their own, with rclpy, on the ROS domain of this test run.


def with_a_program():
    """The pages that have one; that of recordings starts workers and viewers."""
    long = pytest.mark.long("processes many recordings")
    for page in filter(program, PAGES):
        yield pytest.param(page, id=page.name, marks=[long] if page.name == "recordings.md" else [])


@pytest.mark.parametrize("page", [*with_a_program()])
def test_the_programs_of_a_page_run_and_print_what_it_says(page, tmp_path):
    if page.name == "recordings.md":
        for library in ("pyarrow", "distributed", "rerun"):
            pytest.importorskip(library)
    if page.name == "datasets.md":
        pytest.importorskip("pyarrow")
        provide_torch(tmp_path)
    run_program(page, tmp_path)


SHOWN_TESTS = [
    pytest.param(code, id=name)
    for page in PAGES
    for name, code in named_programs(page).items()
    if name.startswith("test_")
]


@pytest.mark.parametrize("code", SHOWN_TESTS)
def test_the_tests_of_a_page_pass(code, tmp_path):
    (tmp_path / "test_page.py").write_text(code, encoding="utf-8")
    output_of("-m", "pytest", "--rootdir", tmp_path, "test_page.py", cwd=tmp_path)


@pytest.mark.long("waits for discovery, twice")
@pytest.mark.parametrize("command", ["view_frames --text", "tf2_echo map camera"])
def test_the_programs_show_the_first_robot_as_the_page_says(command, tmp_path):
    page = ROOT / "docs" / "getting-started.md"
    text = page.read_text(encoding="utf-8")
    [shown] = re.findall(rf"^```sh\n{command}\n```\n\n```text\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    name, *arguments = command.split()
    ending = ["--once", "--wait", str(DEADLINE_S)] if name == "tf2_echo" else []
    started = ["-m", f"tf2_ros_tools.programs.{name}", *arguments, *ending]
    signed = re.compile(r"-?\d+")
    with programs_beside(page, tmp_path):
        # On a busy machine a program may end before it has found the robot.
        printed = (signed.sub("#", output_of(*started, cwd=tmp_path)) for _ in range(4))
        assert any(one.startswith(signed.sub("#", shown)) for one in printed)


def test_the_recorder_saves_what_it_received_until_ctrl_c(tmp_path, peer):
    code = named_programs(ROOT / "docs" / "recordings.md")["record.py"]
    # It says when it has received everything: interrupted before that, there might be nothing to save.
    received = 'print(buffer.can_transform("map", "camera", 1_000_000_000, timeout=60), flush=True)'
    code = code.replace("        time.sleep(60)", f"        {received}\n        time.sleep(60)")
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


def test_the_node_of_getting_started_finds_the_camera(tmp_path):
    page = ROOT / "docs" / "getting-started.md"
    command = [sys.executable, "-c", named_programs(page)["finder.py"]]
    with (
        programs_beside(page, tmp_path),
        killed(subprocess.Popen(command, text=True, stderr=subprocess.PIPE)) as finder,
    ):
        assert "[camera_finder]: the camera is at x = " in finder.stderr.readline()


# Commands: those in blocks, and those in the text.

PROGRAMS = set(PYPROJECT["project"]["scripts"])
EXTRAS = {"", *PYPROJECT["project"]["optional-dependencies"]}
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")


@by_name
def test_the_commands_of_a_page_name_options_targets_and_extras_that_exist(page):
    for _, words in commands(page, *(span for span in SPAN.findall(prose(page)) if " " in span)):
        match words[3:] if words[:3] == ["ros2", "run", "tf2_ros_cython"] else words:
            case [name, *arguments] if name in PROGRAMS and name != "tf2_which":
                program = importlib.import_module(f"tf2_ros_tools.programs.{name}")
                program.PARSER.read([name, *arguments])
            case ["make", target, *_]:
                assert re.search(rf"^[a-z ]*\b{target}\b[a-z ]*:", MAKEFILE, re.MULTILINE), words
            case ["pip", "install", *wanted]:
                named = [extra for one in wanted for extra in re.findall(r"\[(.+)\]", one)]
                assert {extra for extras in named for extra in extras.split(",")} <= EXTRAS, words
            case ["python", "-m", "pytest", *paths]:
                assert all((ROOT / path).exists() for path in paths if path.startswith("tests/")), words
            case ["python", path, *_] if not path.startswith("-"):
                assert (ROOT / path).is_file() or path in FILES, words


def test_the_figures_of_lookups_are_those_of_the_results():
    rows = output_of(ROOT / "docs" / "speed.py", cwd=ROOT).splitlines()
    page = (ROOT / "docs" / "performance.md").read_text(encoding="utf-8")
    assert [row for row in rows if row not in page] == []


# Links and names.


def anchors(page):
    headings = HEADING.findall(prose(page))
    return {re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-") for heading in headings}


@by_name
def test_links_lead_somewhere(page):
    for link in LINK.findall(prose(page)):
        if link.startswith("https://"):
            continue  # no test asks another machine
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


INTERNALS = ROOT / "docs" / "internals.md"


def names_of(page):
    """What is written as code, and what looks like a name in a diagram."""
    diagrams = "\n".join(block.code for block in blocks(page) if block.language in SHOWN)
    words = re.findall(r"(?<![/\w.])[A-Za-z_][\w.]*\w", diagrams)
    # The table of packages is test_layout.py's.
    text = re.sub(r"^\| package \|.*?(?=\n\n)", "", prose(page), flags=re.MULTILINE | re.DOTALL)
    spans = [span for span in SPAN.findall(text) if " " not in span]
    return sorted({*spans, *(word for word in words if re.search(r"[_.]|[a-z][A-Z]", word))})


@pytest.mark.parametrize("name", names_of(INTERNALS))
def test_a_name_in_the_internals_exists(name):
    name = re.sub(r"\(.*\)$|=.*$", "", name)
    assert (ROOT / name).exists() or set(re.findall(r"\w+", name)) <= words_of_sources()


@pytest.mark.long("builds the site")
def test_the_site_builds_without_warnings(tmp_path):
    recipe = (ROOT / "Makefile").read_text(encoding="utf-8")
    [options] = re.findall(r"-m sphinx (.*) -d build/doctrees docs build/docs", recipe)
    command = [sys.executable, "-m", "sphinx", *options.split(), "-d", tmp_path / "trees"]
    ended = run(*command, ROOT / "docs", tmp_path)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")
