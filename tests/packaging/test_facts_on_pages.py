# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Facts that pages state and sources decide: numbers, versions, names, complete lists, and generated tables and
figures.
"""

import re
import runpy

import pytest
from documentation_pages import PAGES, prose
from paths import ROOT
from project_sources import PACKAGES, PYPROJECT, tomllib

from release import prove
from tf2_py import _tf2_py, typing
from tf2_ros import Buffer, StaticTransformBroadcaster, TransformBroadcaster, TransformListener
from tf2_ros._qos import DYNAMIC_DEPTH, STATIC_DEPTH

TOOLS = tomllib.loads((ROOT / "tools" / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CORE = PYPROJECT["project"]
FOR_DEVELOPERS = {"test", "test-all", "docs", "dev"}

# `os.environ.get("NAME"`, `environ["NAME"`, `"NAME" in os.environ`.
READ = re.compile(r"""environ(?:\.get\(|\[)["'](\w+)|["'](\w+)["'] (?:not )?in (?:os\.)?environ\b""")
# Some are read by a name that is put together or kept in a constant.
OURS = re.compile(r"\bTF2_ROS_CYTHON\w*\b")


def text_of(name):
    return " ".join((ROOT / name).read_text(encoding="utf-8").split())


def first_number(pattern, text):
    return int(re.search(pattern, text)[1].replace(",", "").replace("_", ""))


CONFORMANCE = first_number(
    r"for s in SCENARIOS\) == ([\d_]+)", text_of("tests/core/test_recorded_answers.py")
)

MAKEFILES = [ROOT / "Makefile", ROOT / "tools" / "Makefile"]

# What make says of its steps, in MB.
INSTALLED = {
    what: int(size)
    for path in MAKEFILES
    for what, size in re.findall(
        r"Installing ([^$,:]+)\$\(comma\) (\d+) MB", path.read_text(encoding="utf-8")
    )
}
NUMPY = first_number(r"NumPy \((\d+) MB\)", text_of("docs/installing.md"))


@pytest.mark.parametrize(
    ("page", "pattern", "value"),
    [
        ("README.md", r"from PyPI into `\.venv` \((\d+) MB", INSTALLED["ROS 2 Jazzy from PyPI"]),
        (
            "README.md",
            r"make test #[^#]*? installs (\d+) MB more",
            INSTALLED["what the tests use"] + INSTALLED["what the tests of the tools use"],
        ),
        (
            "README.md",
            r"`make -C tools demo`, which\s+installs (\d+) MB",
            INSTALLED["what the demonstration uses"],
        ),
        (
            "README.md",
            r"`make docs` [^)]* \(installs (\d+) MB",
            first_number(r"docs_SIZE := (\d+) MB", text_of("Makefile")),
        ),
        ("docs/installing.md", r"\| `ros` \|[^|]*\| (\d+) MB", INSTALLED["ROS 2 Jazzy from PyPI"] - NUMPY),
        ("SECURITY.md", r"up to ([\d,]+) messages of `/tf`", DYNAMIC_DEPTH),
        ("SECURITY.md", r"([\d,]+) of `/tf_static`", STATIC_DEPTH),
        ("docs/differences.md", r"queue of `/tf_static` \|[^|]*\| ([\d,]+) messages", STATIC_DEPTH),
        ("docs/limits.md", r"\| frames \| ([\d,]+) \|", _tf2_py.LIMITS["max_frames"]),
        ("docs/limits.md", r"\| memory [^|]*\| (\d+) GiB", _tf2_py.LIMITS["max_bytes"] >> 30),
        ("CONTRIBUTING.md", r"replays ([\d,]+) calls", CONFORMANCE),
        ("docs/development/reliability.md", r"all ([\d,]+) answers", CONFORMANCE),
    ],
)
def test_a_number_on_a_page_is_that_of_the_sources(page, pattern, value):
    assert first_number(pattern, text_of(page)) == value


def test_the_page_of_the_environment_shows_the_profiles_that_are_used(node):
    page = (ROOT / "docs" / "environment-and-qos.md").read_text(encoding="utf-8")
    row = re.compile(r"^\|[^|]*\| `(/tf\w*)` \| ([\w ]+) \| ([\w ]+) \| ([\d,]+)", re.MULTILINE)
    shown = [(*words, int(depth.replace(",", ""))) for *words, depth in row.findall(page)]
    listener = TransformListener(Buffer(), node)
    broadcasters = TransformBroadcaster(node), StaticTransformBroadcaster(node)
    used = []
    for one in (listener.tf_sub, listener.tf_static_sub, *(each.pub_tf for each in broadcasters)):
        qos = one.qos_profile
        words = (policy.name.lower().replace("_", " ") for policy in (qos.reliability, qos.durability))
        used.append((one.topic_name, *words, qos.depth))
    assert shown == used


FIGURES = runpy.run_path(str(ROOT / "docs" / "performance_from_results.py"))


@pytest.mark.parametrize(
    ("page", "has_all"), FIGURES["PAGES"].items(), ids=lambda one: getattr(one, "name", "")
)
def test_the_figures_of_a_page_are_those_of_the_report(page, has_all):
    text = page.read_text(encoding="utf-8")
    assert FIGURES["with_figures"](text, has_all) == text, "run python docs/performance_from_results.py"


@pytest.mark.parametrize("page", FIGURES["PAGES"], ids=lambda page: page.name)
def test_a_page_begins_with_the_slowest_lines_and_quotes_no_better_ratio(page):
    text = " ".join(page.read_text(encoding="utf-8").split())
    assert "<!-- headline, " in text and next(FIGURES["sentences"]()) in text
    assert re.findall(r"[\d.,]+ (?:to [\d.,]+ )?times (?:as fast|faster)", text) == []


def extras_in(text):
    """The distribution, and the extra, of each requirement with extras in a text."""
    of = {"tf2-ros-tools": TOOLS, "./tools": TOOLS, "tf2-ros-cython": CORE, ".": CORE}
    for name, extras in re.findall(
        r"(tf2-ros-tools|\./tools|tf2-ros-cython|(?<=['\" ])\.)\[([\w, -]+)\]", text
    ):
        for extra in extras.split(","):
            yield extra.strip(), of[name]["optional-dependencies"]


def sources_with_texts():
    folders = (
        "tf2_py",
        "tf2_ros",
        "tf2_geometry_msgs",
        "tf2_sensor_msgs",
        "tf2_ros_cython",
        "tools/tf2_ros_tools",
    )
    for folder in folders:
        yield from (path for path in (ROOT / folder).rglob("*.p[xy]*") if path.suffix != ".pyc")


def test_an_extra_that_an_error_or_a_page_names_exists():
    paths = [
        *sources_with_texts(),
        *PAGES,
        *(ROOT / "tools").glob("*.md"),
        *(ROOT / "tools/docs").rglob("*.md"),
    ]
    named = [(path, *one) for path in paths for one in extras_in(path.read_text(encoding="utf-8"))]
    assert len({extra for _, extra, _ in named}) > 5
    assert [(str(path), extra) for path, extra, known in named if extra not in known] == []


def test_every_extra_for_users_is_in_the_table_of_its_page():
    for page, project in (("docs/installing.md", CORE), ("tools/README.md", TOOLS)):
        text = (ROOT / page).read_text(encoding="utf-8")
        table = text[text.index("| extra |") :].partition("\n\n")[0]
        rows = set(re.findall(r"^\| `([\w-]+)` \|", table, re.MULTILINE))
        assert rows == project["optional-dependencies"].keys() - FOR_DEVELOPERS, page


def test_the_releases_that_users_read_of_are_those_that_were_tested():
    page = (ROOT / "docs" / "limits.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (?:Humble|Jazzy|Kilted|Lyrical|Rolling) \|(.*)", page, re.MULTILINE)
    versions = set(re.findall(r"(?<![\d.])\d{1,2}\.\d+\.\d+(?=[ ,|])", "\n".join(rows)))
    of_wheels = {"7.1.5", "9.1.2"}
    tested = {name.split("-")[1] for name in prove.RCLPY if not name.startswith("wheels")}
    assert versions == tested | of_wheels


def test_a_page_that_the_sources_name_by_its_title_exists():
    texts = "\n".join(path.read_text(encoding="utf-8") for path in sources_with_texts())
    named = re.findall(r'(?:"([^"\n]+)" on )?the page "([^"\n]+)"', texts, re.IGNORECASE)
    assert ("Laser scans", "Point clouds and scans") in named
    pages = [page.read_text(encoding="utf-8") for page in (*PAGES, *(ROOT / "tools/docs").rglob("*.md"))]
    for section, title in named:
        [page] = [page for page in pages if page.startswith(f"# {title}\n")]
        assert section == "" or f"## {section}\n" in page


PYTHONS = [one.rpartition(" ")[2] for one in CORE["classifiers"] if re.search(r":: 3\.\d+$", one)]


OF_USERS = [page for page in PAGES if page.parent.name != "development"]


@pytest.mark.parametrize("page", OF_USERS, ids=lambda page: page.name)
def test_the_range_of_pythons_on_a_page_is_that_of_the_package(page):
    ranges = re.findall(r"Python (3\.\d+) to (3\.\d+)", " ".join(prose(page).split()))
    of_fuzzer = ("3.11", "3.13")  # atheris
    assert {*ranges} <= {(PYTHONS[0], PYTHONS[-1]), of_fuzzer}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_tables_of_a_page_are_what_the_sources_say(page):
    text = page.read_text(encoding="utf-8")
    assert runpy.run_path(str(ROOT / "docs" / "tables_from_sources.py"))["with_tables"](text) == text


def test_the_types_in_the_reference_are_what_the_sources_say():
    tables = runpy.run_path(str(ROOT / "docs" / "tables_from_sources.py"))
    text = tables["REFERENCE"].read_text(encoding="utf-8")
    assert tables["with_types"](text) == text


def variables_read():
    """The variables that the installed packages and the tools read."""
    found = set()
    for folder in (*PACKAGES, "tools/tf2_ros_tools"):
        for path in (ROOT / folder).rglob("*.py*"):
            if path.suffix in (".py", ".pyx"):
                text = path.read_text(encoding="utf-8")
                found |= {one for pair in READ.findall(text) for one in pair if one} | {*OURS.findall(text)}
    return found - {"TF2_ROS_CYTHON_"}


def test_the_page_of_the_environment_lists_the_variables_that_are_read():
    page = (ROOT / "docs" / "environment-and-qos.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| `([A-Z0-9_]+)`", page, re.MULTILINE)) == variables_read()


@pytest.mark.parametrize("cls", [Buffer, TransformListener])
def test_the_cheat_sheet_lists_every_public_name(cls):
    page = (ROOT / "docs" / "cheat-sheet.md").read_text(encoding="utf-8")
    listed = {one for pair in re.findall(r"(\w+)\(|\.(\w+)", page) for one in pair}
    assert {name for name in dir(cls) if not name.startswith("_")} - listed == set()


def test_the_cheat_sheet_lists_every_argument_of_a_policy():
    page = (ROOT / "docs" / "cheat-sheet.md").read_text(encoding="utf-8")
    assert {*typing.LookupPolicy.__annotations__} <= {*re.findall(r"`(\w+)`", page)}


def test_the_recipe_for_an_argument_of_a_lookup_names_each_file_that_names_all_of_them():
    page = (ROOT / "docs" / "development" / "internals.md").read_text(encoding="utf-8")
    recipe = page.partition("### An argument of a lookup\n")[2].partition("\n## ")[0]
    listed = set(re.findall(r"`([\w/]+/[\w-]+\.\w+)`", recipe))
    folders = ("tf2_py", "tf2_ros", "docs", "tests/support")
    paths = [path for folder in folders for path in (ROOT / folder).rglob("*.*")]
    texts = {
        str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
        for path in [*paths, ROOT / "tests" / "core" / "test_lookup_policies.py"]
        if path.suffix in (".py", ".pyi", ".pyx", ".pxd", ".pxi", ".md")
    }
    arguments = [rf"\b{name}(_ns)?\b" for name in typing.LookupPolicy.__annotations__]
    naming_all = {name for name, text in texts.items() if all(re.search(one, text) for one in arguments)}
    naming_one = {name for name, text in texts.items() if any(re.search(one, text) for one in arguments)}
    assert naming_all - {"docs/development/internals.md"} <= listed <= naming_one
    assert len(re.findall(r"^\d+\. ", recipe, re.MULTILINE)) == 10
