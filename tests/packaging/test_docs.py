# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The documentation: its programs run, its commands work, its links lead somewhere, its names exist."""

import pydoc
import re
import runpy
import subprocess
import sys
from contextlib import ExitStack

import pytest
from documentation_pages import (
    PAGES,
    check_blocks,
    check_links,
    commands_and_spans,
    libraries_of,
    linked_pages,
    named_files,
    named_programs,
    names_of,
    program,
    run_program,
)
from geometry_msgs.msg import TransformStamped
from paths import ROOT
from processes import killed, output_of
from project_sources import PYPROJECT, modules, words_of_sources
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header
from waiting import until

from tf2_ros import TransformBroadcaster

by_name = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


@by_name
def test_every_block_is_found(page):
    check_blocks(page)


# Programs: in a process of their own, with rclpy, on the ROS domain of this test run.


def with_a_program():
    """The pages that have one."""
    for page in filter(program, PAGES):
        marks = [pytest.mark.long(f"needs {name}") for name in libraries_of(page)]
        yield pytest.param(page, id=page.name, marks=marks)


@pytest.mark.parametrize("page", [*with_a_program()])
def test_the_programs_of_a_page_run_and_print_what_it_says(page, tmp_path):
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


def test_the_node_of_the_readme_waits_in_its_callback(tmp_path, node):
    command = [sys.executable, "-c", named_programs(ROOT / "README.md")["scan_pose.py"]]
    scans = node.create_publisher(LaserScan, "scan", 10)
    broadcaster = TransformBroadcaster(node)
    stamps = []

    def is_logged():
        # A scan, and at the next call its pose: the callback waits in between.
        if stamps:
            pose = TransformStamped(child_frame_id="lidar")
            pose.header.frame_id, pose.header.stamp = "map", stamps.pop()
            pose.transform.translation.x = 4.0
            broadcaster.sendTransform(pose)
        elif scans.get_subscription_count() and broadcaster.pub_tf.get_subscription_count():
            stamps.append(node.get_clock().now().to_msg())
            scans.publish(LaserScan(header=Header(frame_id="lidar", stamp=stamps[0])))
        return "[scan_pose]: scanned at x = 4.00 m" in log.read_text()

    log = tmp_path / "log"
    with log.open("w") as stderr, killed(subprocess.Popen(command, stderr=stderr)):
        until(is_logged)


def test_the_node_of_the_readme_logs_the_scans_of_the_example(tmp_path):
    node = named_programs(ROOT / "README.md")["scan_pose.py"]
    commands = [sys.executable, ROOT / "examples" / "scanning_robot.py"], [sys.executable, "-c", node]
    log = tmp_path / "log"
    with log.open("w") as stderr, ExitStack() as started:
        for command in commands:
            started.enter_context(killed(subprocess.Popen(command, stderr=stderr)))
        until(lambda: "[scan_pose]: scanned at x = " in log.read_text())


def test_the_nodes_of_callbacks_look_up_in_one_buffer(tmp_path, node):
    command = [sys.executable, "-c", named_programs(ROOT / "docs" / "callbacks.md")["robot_nodes.py"]]
    broadcaster = TransformBroadcaster(node)

    def are_logged():
        poses = [TransformStamped(child_frame_id=frame) for frame in ("camera", "arm")]
        for pose in poses:
            pose.header.frame_id = "map"
            pose.transform.translation.x = 4.0
        broadcaster.sendTransform(poses)
        said = log.read_text()
        return all(f"[watches_{frame}]: {frame} is at x = 4.00 m" in said for frame in ("camera", "arm"))

    log = tmp_path / "log"
    with log.open("w") as stderr, killed(subprocess.Popen(command, stderr=stderr)):
        until(are_logged)


def test_the_demonstration_prints_what_the_readme_shows():
    page = (ROOT / "README.md").read_text(encoding="utf-8")
    [shown] = re.findall(r"\nmake demo .*?```.*?```text\n(.*?)```", page, re.DOTALL)
    # The robot is anywhere on its circle: coordinates have other signs and widths.
    numbers = re.compile(r" *-?\d+\.\d+")
    printed = numbers.sub(" #", output_of(ROOT / "examples" / "demo.py"))
    assert numbers.sub(" #", shown) in printed


# Commands: those in blocks, and those in the text.

EXTRAS = {"", *PYPROJECT["project"]["optional-dependencies"]}
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
FILES = named_files(PAGES)


@by_name
def test_the_commands_of_a_page_name_targets_files_and_extras_that_exist(page):
    """The tools' tests have their options, and their extras."""
    for words in commands_and_spans(page):
        match words:
            case ["make", target, *_] if not target.startswith("-"):
                assert re.search(rf"^[a-z ]*\b{target}\b[a-z ]*:", MAKEFILE, re.MULTILINE), words
            case ["pip", "install", *wanted]:
                ours = [one for one in wanted if "tools" not in one]
                named = [extra for one in ours for extra in re.findall(r"\[(.+)\]", one)]
                assert {extra for extras in named for extra in extras.split(",")} <= EXTRAS, words
            case ["source", file, *more] if file != "=":  # not also the command of the next line
                assert more == [], words
            case ["python", "-m", "pytest", *paths]:
                assert all((ROOT / path).exists() for path in paths if path.startswith("tests/")), words
            case ["python", path, *_] if not path.startswith("-"):
                assert (ROOT / path).is_file() or path in FILES, words


# Commands that start what publishes, or may. `my_robot` is a package of the reader, for a robot.
PUBLISHES = re.compile(
    r"ros2 (run (?!my_robot)|launch|bag play|topic pub)|examples/\w+\.py"
    r"|^static_transform_publisher|^tf2_buffer_server",
    re.MULTILINE,
)
KEPT_HERE = re.compile(r"#keep-programs-on-this-machine|ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST")


def test_pages_that_start_what_publishes_say_how_to_keep_it_on_this_machine():
    pages = [*PAGES, *(ROOT / "tools").glob("docs/**/*.md"), ROOT / "tools" / "README.md"]
    texts = {str(page.relative_to(ROOT)): page.read_text(encoding="utf-8") for page in pages}
    commands = {
        name: "".join(re.findall(r"^ *```sh\n(.*?)^ *```", text, re.MULTILINE | re.DOTALL))
        for name, text in texts.items()
    }
    starting = {name for name, lines in commands.items() if PUBLISHES.search(lines)}
    assert {"README.md", "tools/docs/programs/publishing.md"} <= starting
    assert [name for name in starting if not KEPT_HERE.search(texts[name])] == []
    for example in (ROOT / "examples").glob("*.py"):
        text = example.read_text(encoding="utf-8")
        assert "Broadcaster" not in text or "LOCALHOST" in text, example.name


# Links and names.


@by_name
def test_links_lead_somewhere(page):
    check_links(page)


def test_the_index_lists_all_pages_except_those_for_maintainers():
    names = runpy.run_path(str(ROOT / "docs" / "pages_for_sphinx.py"))["FOR_MAINTAINERS"]
    for_maintainers = {ROOT / f"{name}.md" for name in names}
    index = ROOT / "docs" / "index.md"
    pages = {*PAGES, *(ROOT / "tools" / "docs").rglob("*.md")}
    assert pages - linked_pages(index) == {index, *for_maintainers}
    assert for_maintainers <= linked_pages(ROOT / "CONTRIBUTING.md")


REFERENCE = [*(ROOT / "docs" / "api").glob("*.rst"), *(ROOT / "tools" / "docs" / "api").glob("*.rst")]


@pytest.mark.parametrize("page", REFERENCE, ids=lambda page: page.name)
def test_the_documents_that_the_reference_names_exist(page):
    for name in re.findall(r":doc:`([^`<]+)`", page.read_text(encoding="utf-8")):
        assert list(page.parent.glob(f"{name}.*")), name


@pytest.mark.parametrize("page", REFERENCE, ids=lambda page: page.name)
def test_the_reference_names_no_member_that_its_class_lists(page):
    # Sphinx warns about both, which ends `make docs`.
    lists_all = r"autoclass:: (\S+)\n   :members:\n((?:   .*\n|\n)*)"
    for name, more in re.findall(lists_all, page.read_text(encoding="utf-8")):
        if named := set(re.findall(r"automethod:: (\w+)", more)):
            assert named.isdisjoint(vars(pydoc.locate(name))), name


INTERNALS = ROOT / "docs" / "development" / "internals.md"


@pytest.mark.parametrize("name", names_of(INTERNALS))
def test_a_name_in_the_internals_exists(name):
    name = re.sub(r"\(.*\)$|=.*$", "", name)
    assert (ROOT / name).exists() or name in modules() or set(re.findall(r"\w+", name)) <= words_of_sources()
