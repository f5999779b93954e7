# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The hints of the public classes, functions and methods resolve at run time."""

import inspect
import typing

import pytest

from tf2_ros_tools import bag, live, urdf


def hinted():
    """The public classes and functions, and the public methods that the classes define, by name."""
    for module in (bag, live, urdf):
        for name in module.__all__:
            thing = getattr(module, name)
            yield f"{module.__name__}.{name}", thing
            for of, member in vars(thing).items() if inspect.isclass(thing) else ():
                member = getattr(member, "__func__", getattr(member, "fget", member))
                if inspect.isfunction(member) and (not of.startswith("_") or of == "__init__"):
                    yield f"{module.__name__}.{name}.{of}", member


HINTED = dict(hinted())


@pytest.mark.parametrize("name", HINTED)
def test_hints_resolve_at_run_time(name):
    thing = HINTED[name]
    hints = [*typing.get_type_hints(thing).values()]
    if not (inspect.isclass(thing) and issubclass(thing, Exception)):  # which have no signature
        hints += [one.annotation for one in inspect.signature(thing, eval_str=True).parameters.values()]
    assert [one for one in hints if isinstance(one, (str, typing.ForwardRef))] == []
