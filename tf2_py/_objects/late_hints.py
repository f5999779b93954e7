# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Import what hints name when somebody reads the hints."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from _collections_abc import dict_items, dict_keys


class LateHints(dict[str, Any]):
    """
    The ``__annotations__`` of a function or class, as texts.

    ``typing.get_type_hints`` and ``inspect`` read all of them before they evaluate the texts in the module of
    the function, which has the names by then.

    :param hints: the annotations.
    :param module: the namespace of that module.
    """

    def __init__(self, hints: dict[str, Any], module: dict[str, Any]) -> None:
        super().__init__(hints)
        self._module = module

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def keys(self) -> "dict_keys[str, Any]":
        self._import_names()
        return super().keys()

    def items(self) -> "dict_items[str, Any]":
        self._import_names()
        return super().items()

    def _import_names(self) -> None:
        from tf2_py._objects import hinted_names

        for name in hinted_names.__all__:
            self._module.setdefault(name, getattr(hinted_names, name))
