# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The versions of what a release uploads fit each other, in all places that name them."""

import sys

import yaml
from paths import ROOT
from project_sources import PYPROJECT

sys.path.insert(0, str(ROOT))
from release import wheels
from release.version_check import contradictions


def test_the_versions_of_this_checkout_fit_each_other():
    assert contradictions() == []


def test_messages_are_published_for_the_releases_that_an_extra_installs():
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "wheels.yml").read_text(encoding="utf-8"))
    published = workflow["jobs"]["messages"]["strategy"]["matrix"]["ros"]
    assert published == [release for release, extras in wheels.RELEASES.items() if extras]
    extras = PYPROJECT["project"]["optional-dependencies"]
    named = {text for texts in extras.values() for text in texts if "-msgs-" in text}
    assert {text.partition(">")[0] for text in named} == {f"tf2-ros-cython-msgs-{one}" for one in published}
