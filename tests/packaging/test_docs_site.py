"""The site of the documentation: no warnings, no dead links, and a complete reference."""

import importlib
import re
import subprocess
import sys
from html.parser import HTMLParser
from urllib.parse import unquote, urlsplit

import pytest
from paths import ROOT
from processes import DEADLINE_S
from public_names import MODULES, OURS
from sources import PACKAGES

pytestmark = pytest.mark.ours

of_the_site = pytest.mark.long("builds the site")

OPTIONS = ["-E", "-W", "--keep-going", "-q"]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The end of the build, and its folder."""
    folder = tmp_path_factory.mktemp("site")
    command = [
        sys.executable,
        "-m",
        "sphinx",
        *OPTIONS,
        "-d",
        folder / "doctrees",
        ROOT / "docs",
        folder / "html",
    ]
    return subprocess.run(command, text=True, capture_output=True, timeout=6 * DEADLINE_S), folder / "html"


@pytest.fixture(scope="module")
def site(built):
    """The folder with the site."""
    return built[1]


@of_the_site
def test_it_builds_without_warnings(built):
    ended, _ = built
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")


def test_make_builds_it_with_the_same_options():
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert f"$(PY) -m sphinx {' '.join(OPTIONS)} -d build/doctrees docs build/docs" in text


class Page(HTMLParser):
    """What a page links to, and the places in it that can be linked to."""

    def __init__(self, path):
        super().__init__()
        self.links, self.anchors = [], {""}
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.anchors |= {attributes[key] for key in ("id", "name") if attributes.get(key)}
        self.links += [attributes[key] for key in ("href", "src") if attributes.get(key)]


@of_the_site
def test_every_link_leads_somewhere_on_the_site(site):
    pages = {path.resolve(): Page(path) for path in site.rglob("*.html")}
    assert len(pages) > len(list((ROOT / "docs").glob("*.md")))
    wrong = []
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not target.exists():
                wrong.append((path.name, link))
            elif target in pages and parts.fragment:
                wrong += [(path.name, link)] * (unquote(parts.fragment) not in pages[target].anchors)
    assert wrong == []


@of_the_site
def test_every_page_is_in_the_contents(site):
    contents = Page(site / "index.html").links
    pages = {path.stem for path in (ROOT / "docs").glob("*.md")} - {"index"}
    assert {f"{page}.html" for page in pages} <= set(contents)
    assert {f"api/{path.stem}.html" for path in (ROOT / "docs" / "api").iterdir()} <= set(contents)


@of_the_site
def test_the_pages_from_outside_the_folder_are_there_as_a_whole(site):
    for name in ("CONTRIBUTING", "SECURITY"):
        html = (site / "site" / f"{name.lower()}.html").read_text(encoding="utf-8")
        headings = re.findall(r"^## (.*)$", (ROOT / f"{name}.md").read_text(encoding="utf-8"), re.MULTILINE)
        assert len(headings) > 3
        assert [heading for heading in headings if f"<h2>{heading}<" not in html] == []


def documented():
    text = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs" / "api").glob("*.rst"))
    found = set(re.findall(r"^\.\. auto(?:class|exception|function):: ([\w.]+)", text, re.MULTILINE))
    for module in re.findall(r"^\.\. automodule:: ([\w.]+)", text, re.MULTILINE):
        found |= {f"{module}.{name}" for name in importlib.import_module(module).__all__}
    for module, names in re.findall(
        r"^\.\. py:currentmodule:: (\S+)(.*?)(?=^\.\. py:current|\Z)", text, re.M | re.S
    ):
        found |= {f"{module}.{name}" for name in re.findall(r"^\.\. py:data:: (\w+)", names, re.MULTILINE)}
    return found


def is_ours(value):
    # Without modules, and without message classes and what else of rclpy can be imported here.
    return callable(value) and (getattr(value, "__module__", None) or "").partition(".")[0] in PACKAGES


def public():
    for module in PACKAGES[: PACKAGES.index("tf2_ros_tools")]:
        content = importlib.import_module(module)
        for name in {*vars(content), *OURS[module]} - {"add_dll_directories_from_env"}:
            if not name.startswith("_") and is_ours(getattr(content, name)):
                yield module, name
    tools = ("tf2_ros_tools.bag", "tf2_ros_tools.rerun", "tf2_ros_tools.urdf")
    for module in ("tf2_py.typing", "tf2_ros.numpy", "tf2_ros.records", *tools):
        yield from ((module, name) for name in MODULES[module])


def test_every_public_class_and_function_is_in_the_reference():
    described = documented()
    # tf2_ros repeats the names of tf2_py.
    missing = [
        f"{module}.{name}"
        for module, name in public()
        if not {f"{module}.{name}", f"tf2_py.{name}" if module == "tf2_ros" else ""} & described
    ]
    assert missing == []


@of_the_site
def test_every_described_name_is_on_the_site(site):
    anchors = set().union(*(Page(path).anchors for path in (site / "api").glob("*.html")))
    assert documented() - anchors == set()
    core = importlib.import_module("tf2_py").BufferCore  # whose methods are listed, in an order for readers
    assert {f"tf2_py.BufferCore.{name}" for name in dir(core) if not name.startswith("_")} <= anchors
