"""The documentation: its programs run, its commands work, its links lead somewhere, its names exist."""

import importlib
import json
import re
import runpy
import shlex
import signal
import subprocess
import sys
from xml.etree import ElementTree

import pytest
from packaging.requirements import Requirement
from pages import (
    CHECKED,
    FILES,
    HEADING,
    LINK,
    PAGES,
    RUN,
    SAMPLES,
    SHOWN,
    SPAN,
    blocks,
    named_programs,
    program,
    programs_beside,
    prose,
    provide_torch,
    run_program,
)
from paths import ROOT, TESTS
from processes import DEADLINE_S
from sources import PACKAGES, PYPROJECT, imported_from_outside, is_defined, is_literal, modules, names_in

pytestmark = pytest.mark.ours

by_name = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)

# By these tests, which read the page.
APPLIED = {
    "cython": "packaging/test_adding_a_type.py",
    "toml": "packaging/test_typing.py",
    "dockerfile": "packaging/test_docs.py",
    "xml": "packaging/test_docs.py",
}


@by_name
def test_every_block_is_run_or_checked(page):
    opened = re.findall(r"^ *```", page.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(opened) == 2 * len(list(blocks(page)))
    languages = {block.language for block in blocks(page)}
    assert languages <= {RUN, CHECKED, *SHOWN, *APPLIED}
    for test in (APPLIED[language] for language in languages & APPLIED.keys()):
        assert page.name in (TESTS / test).read_text(encoding="utf-8")


@by_name
def test_no_code_in_the_text_is_broken_by_the_end_of_a_line(page):
    assert [line for line in prose(page).splitlines() if line.count("`") % 2] == []


# Programs: in a process of their own, with rclpy, on the ROS domain of this test run.


@pytest.mark.parametrize("page", [page for page in PAGES if program(page)], ids=lambda page: page.name)
def test_the_programs_of_a_page_run_and_print_what_it_says(page, tmp_path):
    if page.name == "recordings.md":
        for library in ("pyarrow", "distributed", "rerun"):
            pytest.importorskip(library)
    if page.name == "datasets.md":
        provide_torch(tmp_path)
    run_program(page, tmp_path)


def test_the_samples_are_what_their_script_writes(tmp_path):
    any_reader = pytest.importorskip("rosbags.highlevel").AnyReader
    runpy.run_path(str(ROOT / "docs" / "samples.py"))["write"](tmp_path / "samples")

    def contents(folder):
        for path in sorted(folder.rglob("metadata.yaml")):
            with any_reader([path.parent]) as reader:
                for connection, log_ns, raw in reader.messages():
                    yield path.relative_to(folder), connection.topic, connection.msgtype, log_ns, bytes(raw)

    assert [*contents(SAMPLES)] == [*contents(tmp_path / "samples")]
    assert (SAMPLES / "arm.urdf").read_bytes() == (tmp_path / "samples" / "arm.urdf").read_bytes()


SHOWN_TESTS = [
    pytest.param(code, id=name)
    for page in PAGES
    for name, code in named_programs(page).items()
    if name.startswith("test_")
]


@pytest.mark.parametrize("code", SHOWN_TESTS)
def test_the_tests_of_a_page_pass(code, tmp_path):
    (tmp_path / "test_page.py").write_text(code, encoding="utf-8")
    run([sys.executable, "-m", "pytest", "--rootdir", tmp_path, "test_page.py"], tmp_path)


@pytest.mark.parametrize("command", ["view_frames --text", "tf2_echo map camera"])
def test_the_programs_show_the_first_robot_as_the_page_says(command, tmp_path):
    page = ROOT / "docs" / "getting-started.md"
    text = page.read_text(encoding="utf-8")
    [shown] = re.findall(rf"^```sh\n{command}\n```\n\n```text\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    name, *arguments = command.split()
    ending = ["--once", "--wait", str(DEADLINE_S)] if name == "tf2_echo" else []
    started = [sys.executable, "-m", f"tf2_ros_tools.programs.{name}", *arguments, *ending]
    signed = re.compile(r"-?\d+")
    with programs_beside(page, tmp_path):
        # On a busy machine a program may end before it has found the robot.
        printed = (signed.sub("#", run(started, tmp_path).stdout) for _ in range(4))
        assert any(one.startswith(signed.sub("#", shown)) for one in printed)


def test_the_first_robot_ends_on_ctrl_c_without_a_traceback(tmp_path):
    code = named_programs(ROOT / "docs" / "getting-started.md")["robot.py"]
    # It says when it drives: interrupted before that, it might not spin yet.
    code = code.replace("self.angle += 0.02", 'self.angle += 0.02\n        print("drives", flush=True)')
    with subprocess.Popen(
        [sys.executable, "-c", code], cwd=tmp_path, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as robot:
        try:
            assert robot.stdout.readline() == "drives\n"
            robot.send_signal(signal.SIGINT)
            _, errors = robot.communicate(timeout=DEADLINE_S)
        finally:
            robot.kill()
    assert (robot.returncode, errors) == (0, "")


def test_the_recorder_saves_what_it_received_until_ctrl_c(tmp_path, peer):
    code = named_programs(ROOT / "docs" / "recordings.md")["record.py"]
    # It says when it has received everything: interrupted before that, there might be nothing to save.
    received = 'print(buffer.can_transform("map", "camera", 1_000_000_000, timeout=60), flush=True)'
    code = code.replace("        time.sleep(60)", f"        {received}\n        time.sleep(60)")
    with subprocess.Popen(
        [sys.executable, "-c", code], cwd=tmp_path, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as recorder:
        try:
            assert recorder.stdout.readline() == "Recording for 60 s, or until Ctrl-C\n"
            robot = peer()
            robot.send(("base_link", "camera", 0, 0.5), static=True)
            robot.send(("map", "base_link", 1_000_000_000, 1.0))
            assert recorder.stdout.readline() == "True\n"
            recorder.send_signal(signal.SIGINT)
            _, errors = recorder.communicate(timeout=DEADLINE_S)
        finally:
            recorder.kill()
    assert (recorder.returncode, errors) == (0, "")
    buffer = importlib.import_module("tf2_ros_tools.bag").load(tmp_path / "live.mcap")
    assert buffer.lookup_transform("map", "camera", 1_000_000_000).transform.translation.x == 1.5


def test_the_node_of_getting_started_finds_the_camera(tmp_path):
    page = ROOT / "docs" / "getting-started.md"
    with (
        programs_beside(page, tmp_path),
        subprocess.Popen(
            [sys.executable, "-c", named_programs(page)["finder.py"]], text=True, stderr=subprocess.PIPE
        ) as finder,
    ):
        try:
            assert "[camera_finder]: the camera is at x = " in finder.stderr.readline()
        finally:
            finder.kill()


# Commands: those in blocks, and those in the text.

PROGRAMS = set(PYPROJECT["project"]["scripts"])
COMMANDS = {"colcon", "evo_traj", "make", "pip", "python", "ros2", "source"} | PROGRAMS
# What only another file of tests/ can run, and a part of it that shows that it does.
RUN_ELSEWHERE = {
    "colcon build": ("packaging/test_colcon.py", '[colcon, "build", *options]'),
    "source install/setup.bash": ("packaging/test_colcon.py", "install/setup.bash"),
    "source .venv/bin/activate": ("../Makefile", "-m venv"),
    "source ~/tf2/bin/activate": ("packaging/test_docs.py", '"bin" / "activate"'),
    "ros2 run tf2_ros_cython tf2_which": ("packaging/test_colcon.py", '"tf2_which"'),
    "evo_traj mcap drive.mcap /tf:map.base_link --save_as_tum": (
        "recordings/test_evo.py",
        '("mcap", str(path), "/tf:map.camera")',
    ),
    "evo_traj tum drive.tum": ("recordings/test_evo.py", '("tum", str(ours))'),
}
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")


def commands(page):
    lines = [line for block in blocks(page) if block.language == CHECKED for line in block.code.splitlines()]
    spans = [span for span in SPAN.findall(prose(page)) if span.split()[0] in COMMANDS and " " in span]
    return list(
        dict.fromkeys(" ".join(shlex.split(line, comments=True, posix=False)) for line in lines + spans)
    )


@pytest.mark.parametrize(
    "command", list(dict.fromkeys(command for page in PAGES for command in commands(page) if command))
)
def test_a_command_is_one_that_works(command, tmp_path):
    check_command(command, tmp_path)


def check_command(command, folder):
    if command in RUN_ELSEWHERE:
        test, part = RUN_ELSEWHERE[command]
        assert part in (TESTS / test).read_text(encoding="utf-8")
        return
    words = shlex.split(command)
    while re.fullmatch(r"[A-Z0-9_]+=.*", words[0]):
        assert is_literal(words[0].partition("=")[0]), f"no source reads {words[0]}"
        del words[0]
    match words:
        case ["tf2_which"]:
            module, _, function = PYPROJECT["project"]["scripts"]["tf2_which"].partition(":")
            # Started as the script that pip makes of it: the current folder is not on the path.
            run([sys.executable, "-c", f"import {module} as m, sys; sys.exit(m.{function}())"], folder)
        case [name, *arguments] if name in PROGRAMS:
            check_program(name, arguments)
        case ["ros2", "bag", "play" | "record" | "reindex"]:
            pass  # of rosbag2, which is not among the ROS 2 wheels
        case ["ros2", "run", "tf2_ros", "tf2_echo"]:
            pass  # tf2's own
        case ["ros2", "run", "tf2_ros_cython", name, *arguments] if name in PROGRAMS:
            check_program(name, arguments)
        case ["cp", "-r", source, _place]:
            assert (ROOT / source).is_dir()
        case ["make", target, *settings]:
            check_make(target, settings)
        case ["pip", "install", *arguments]:
            check_pip_install(arguments)
        case ["pip", "uninstall", name]:
            assert name == PYPROJECT["project"]["name"]
        case ["python3", "-m", "venv", *options, _place]:
            subprocess.run([sys.executable, "-m", "venv", "--without-pip", *options, folder], check=True)
            assert (folder / "bin" / "activate").is_file()
        case ["python", "-m", "pytest", *arguments]:
            check_pytest(arguments)
        case ["python", "-m", "tf2_ros_cython"]:
            run([sys.executable, "-m", "tf2_ros_cython"], folder)
        case ["python", "-m", module, *arguments]:
            said = run([sys.executable, "-m", module, "--help"], ROOT).stdout
            assert all(one in said for one in arguments if one.startswith("-"))
        case ["python", "setup.py", "build_ext", "--inplace"]:
            assert "$(PY) setup.py -q build_ext --inplace" in MAKEFILE
        case ["python", path]:
            assert (ROOT / path).is_file() or path in FILES
        case _:
            pytest.fail(f"nothing says how to check: {command}")


def applied(page, language):
    [code] = [block.code for block in blocks(ROOT / "docs" / page) if block.language == language]
    return code


def test_the_dockerfile_installs_as_the_page_says(tmp_path):
    """No image is built: its commands are checked as those of a page."""
    text = applied("installing.md", "dockerfile").replace("\\\n", " ")
    [clone] = re.findall(r"^COPY \. (.*)$", text, re.MULTILINE)
    [environment] = re.findall(r"^ENV PATH=(.*):", text, re.MULTILINE)
    steps = [step for line in re.findall(r"^RUN (.*)$", text, re.MULTILINE) for step in line.split(" && ")]
    ours = [step for step in steps if step.split()[0] not in (".", "apt-get", "rm")]
    for step in ours:
        check_command(step.replace(f"{environment}/", "").replace(clone, "."), tmp_path)
    assert ours[-1] == "tf2_which"


def test_the_launch_file_starts_programs_that_exist(tmp_path):
    parts = [*ElementTree.fromstring(applied("beside-cpp.md", "xml"))]
    assert {part.tag for part in parts} == {"executable", "node", "set_env"}
    for part in parts:
        if part.tag == "executable":
            check_command(part.attrib["cmd"], tmp_path)
        elif part.tag == "set_env":
            assert is_literal(part.attrib["name"])
        elif part.attrib["pkg"] == "tf2_ros":
            check_program(part.attrib["exec"], shlex.split(part.attrib["args"]))


def check_make(target, settings):
    [phony] = re.findall(r"^\.PHONY: (.*)$", MAKEFILE, re.MULTILINE)
    assert target in phony.split() and re.search(rf"^[a-z ]*\b{target}\b[a-z ]*:", MAKEFILE, re.MULTILINE)
    for setting in settings:
        assert f"$({setting.partition('=')[0]})" in MAKEFILE or f"({setting.partition('=')[0]})," in MAKEFILE


def check_program(name, arguments):
    """As the program would read its command line."""
    importlib.import_module(f"tf2_ros_tools.programs.{name}").parser().read([name, *arguments])


AS_PIP_READS = """
import json, sys
sys.path.insert(0, "messages")
from backend import environment  # before pip: it replaces distutils
from pip._internal.commands import create_command
options, wanted = create_command("install").parse_args(sys.argv[1:])
print(json.dumps([wanted + options.editables, options.config_settings or {}, list(environment.RCLPY_OF)]))
"""


def check_pip_install(arguments):
    """As pip would read it: the projects, with extras that they have, or a requirement that they name."""
    read = run([sys.executable, "-c", AS_PIP_READS, *arguments], ROOT).stdout
    [*more, wanted], settings, choices = json.loads(read.splitlines()[-1])
    for key, value in settings.items():
        assert key == "ros" and value in choices
    assert more in ([], ["./messages"])
    if wanted == "./messages":
        assert (ROOT / wanted / "setup.py").is_file()
    elif wanted.startswith("."):
        assert set(re.split(r"[\[\],]", wanted[1:])) <= {"", *PYPROJECT["project"]["optional-dependencies"]}
    elif (asked := Requirement(wanted)).name == PYPROJECT["project"]["name"]:
        assert asked.extras and asked.extras <= set(PYPROJECT["project"]["optional-dependencies"])
    else:
        required = [Requirement(one) for one in PYPROJECT["build-system"]["requires"]]
        assert (asked.name, asked.specifier) in [(one.name, one.specifier) for one in required]


def check_pytest(arguments):
    ended = run([sys.executable, "-m", "pytest", "--collect-only", "-q", *arguments], ROOT)
    assert re.search(r"^[1-9]\d*(/\d+)? tests? collected", ended.stdout, re.MULTILINE)


def run(command, folder):
    ended = subprocess.run(command, cwd=folder, text=True, capture_output=True, timeout=3 * DEADLINE_S)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended


def test_the_figures_of_lookups_are_those_of_the_results():
    rows = run([sys.executable, ROOT / "docs" / "speed.py"], ROOT).stdout.splitlines()
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


@by_name
def test_a_page_is_linked_from_the_readme_or_the_index(page):
    entries = (ROOT / "README.md", ROOT / "docs" / "index.md")
    links = [(entry.parent / link).resolve() for entry in entries for link in LINK.findall(prose(entry))]
    assert page in (*entries, *links)


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
    assert is_known(name)


def is_known(name):
    return is_defined(name) or is_literal(name) or name in imported_from_outside() or (ROOT / name).exists()


# How the other pages call an object of a class.
OBJECTS = {
    "buffer": "tf2_ros.Buffer",
    "listener": "tf2_ros.TransformListener",
    "executor": "rclpy.executors.Executor",
}


@pytest.mark.parametrize("page", [page for page in PAGES if page != INTERNALS], ids=lambda page: page.name)
def test_the_names_on_a_page_exist(page):
    names = (re.sub(r"\(.*\)$|=.*$", "", name) for name in names_of(page))
    ours = [name for name in names if re.fullmatch(r"[A-Za-z_][\w.]*", name) and re.search(r"[_.]\w", name)]
    assert [name for name in ours if not exists(name)] == []


def exists(name):
    owner, _, member = name.rpartition(".")
    if owner in OBJECTS:
        module, _, kind = OBJECTS[owner].rpartition(".")
        return member in dir(getattr(importlib.import_module(module), kind)) or is_known(member)
    if owner in (*PACKAGES, "tf2_ros_tools.bag", "tf2_ros_tools.rerun", "tf2_ros_tools.urdf", "rclpy"):
        return hasattr(importlib.import_module(owner), member) or name in modules()
    if name.startswith("test_"):
        return any(name in names_in(path) for module in modules().values() for path in module)
    if name in FILES:
        return True
    limits = importlib.import_module("tf2_py._tf2_py").LIMITS
    variables = {f"TF2_ROS_CYTHON_{limit.upper()}" for limit in limits}
    of_ros = {"setup.bash", "ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE", "frame_ids"}
    of_mypy = {"tool.mypy", "mypy_path", "disallow_untyped_calls"}
    return name in (variables | of_ros | of_mypy) or name in PYPROJECT["project"]["scripts"] or is_known(name)
