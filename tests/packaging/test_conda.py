# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The recipe for conda, and the example for pixi."""

import re
import sys

import pytest
import yaml
from packaging.requirements import Requirement
from paths import ROOT
from project_sources import PYPROJECT, tomllib

sys.path.insert(0, str(ROOT))

RECIPE = ROOT / "release" / "conda" / "recipe.yaml"


def test_the_recipe_for_conda_requires_what_the_project_does():
    recipe = yaml.safe_load(RECIPE.read_text(encoding="utf-8"))
    project = PYPROJECT["project"]
    assert recipe["context"]["version"] == project["version"]
    assert recipe["about"]["summary"] == project["description"]

    def bounds(requirements):
        wanted = map(Requirement, requirements)
        return {one.name.lower(): one.specifier for one in wanted if one.name not in ("python", "pip")}

    assert bounds(recipe["requirements"]["host"]) == bounds(PYPROJECT["build-system"]["requires"])
    assert bounds(recipe["requirements"]["run"]) == bounds(project["dependencies"])


@pytest.mark.long("needs rattler_build")
def test_rattler_build_renders_the_recipe_for_each_python():
    rattler_build = pytest.importorskip("rattler_build")
    recipe = rattler_build.Stage0Recipe.from_file(RECIPE)
    assert recipe.to_dict()["build"]["skip"] == ["win"]
    variants = rattler_build.VariantConfig.from_yaml(
        "{python: [3.10.*, 3.14.*], c_compiler: [gcc], c_stdlib: [sysroot]}"
    )
    platform = rattler_build.PlatformConfig(target_platform="linux-64", host_platform="linux-64")
    rendered = recipe.render(variants, rattler_build.RenderConfig(platform))
    made = [one.recipe.to_dict() for one in rendered]
    assert [one["build"]["string"][:5] for one in made] == ["py310", "py314"]
    assert {one["package"]["version"] for one in made} == {PYPROJECT["project"]["version"]}
    assert all("gcc_linux-64" in one["requirements"]["build"] for one in made)


def test_the_example_for_pixi_takes_both_projects_of_a_clone():
    workspace = tomllib.loads((ROOT / "examples" / "pixi.toml").read_text(encoding="utf-8"))
    assert workspace["workspace"]["channels"] == ["robostack-jazzy", "conda-forge"]
    for name, wanted in workspace["pypi-dependencies"].items():
        folder = ROOT / re.sub(r"^tf2-ros-cython/?", "", wanted["path"])
        project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        assert project["name"] == name
        assert {*wanted.get("extras", ())} <= project["optional-dependencies"].keys()
