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
