"""The extensions compile for other machines; `make cross` also runs tests on an emulated one."""

import sys

import pytest
from paths import ROOT

pytestmark = [pytest.mark.ours, pytest.mark.long("fetches compilers")]

sys.path.insert(0, str(ROOT))
from release import cross_compile  # noqa: E402


@pytest.mark.parametrize("name", cross_compile.TARGETS)
def test_the_extensions_compile(name):
    try:
        tools = cross_compile.tools_for(name)
    except cross_compile.Unavailable as error:
        pytest.skip(str(error))
    _, errors = cross_compile.build(name, tools, "-O0")
    assert errors == {}
