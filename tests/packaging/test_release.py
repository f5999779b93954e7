"""What makes and tests the wheels names what there is."""

import sys

import pytest
from paths import ROOT

pytestmark = pytest.mark.ours

pytest.importorskip("packaging")
from packaging.requirements import Requirement  # noqa: E402

sys.path.insert(0, str(ROOT))
from release import bare, wheels  # noqa: E402


@pytest.mark.parametrize("path", [*bare.QUICK, *(f"tests/{name}" for name in wheels.OF_SOURCES)])
def test_the_tests_that_are_named_exist(path):
    assert (ROOT / path).is_file()


def test_what_users_install_has_lower_bounds_and_the_oldest_are_tried():
    extras = wheels.PROJECT["optional-dependencies"]
    for_users = [wheels.PROJECT["dependencies"], *(extras[name] for name in ("rerun", *wheels.OLDEST_EXTRAS))]
    required = [Requirement(text) for texts in for_users for text in texts]
    assert [one.name for one in required if ">=" not in str(one.specifier)] == []
    tried = {text.partition("==")[0] for text in wheels.oldest_requirements()}
    assert {one.name for one in required} - tried == {"rerun-sdk"}


def test_all_extras_for_users_are_known_to_the_test_of_the_oldest():
    others = {"ros", "ros-kilted", "rerun", "test", "test-all", "bench", "docs", "release", "dev"}
    assert set(wheels.PROJECT["optional-dependencies"]) - others == set(wheels.OLDEST_EXTRAS)


@pytest.mark.parametrize(
    "named, known",
    [
        (("gcc", "g++"), {"gcc", "g++"}),  # which are in the list too
        (("x86_64-linux-gnu-gcc -pthread", ""), {"x86_64-linux-gnu-gcc"}),
        (("/opt/llvm/bin/clang", None), set()),  # found by its path
    ],
)
def test_the_compilers_that_python_names_are_kept_for_a_bare_user(tmp_path, monkeypatch, named, known):
    monkeypatch.setattr(bare.sysconfig, "get_config_var", dict(zip(("CC", "CXX"), named, strict=True)).get)
    programs = tmp_path / "bin"
    programs.mkdir()
    bare._link_programs(programs)
    linked = {path.name for path in programs.iterdir()}
    wanted = {*bare.COMPILERS, *bare.SYSTEM, *known}
    assert linked == {name for name in wanted if bare.shutil.which(name)} | {"python3"}
