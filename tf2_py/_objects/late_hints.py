# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Import what hints name when somebody reads the hints."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, ForwardRef

if TYPE_CHECKING:
    from _collections_abc import dict_items, dict_keys


class _Late(dict[str, Any]):
    """An ``__annotations__`` that is prepared when ``typing.get_type_hints`` or ``inspect`` reads it."""

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def keys(self) -> "dict_keys[str, Any]":
        self._prepare()
        return super().keys()

    def items(self) -> "dict_items[str, Any]":
        self._prepare()
        return super().items()

    def _prepare(self) -> None:
        raise NotImplementedError


class LateHints(_Late):
    """
    The hints of a function, as texts.

    ``typing.get_type_hints`` and ``inspect`` read all of them before they evaluate the texts in the module of
    the function, which has the names by then.

    :param hints: the annotations.
    :param module: the namespace of that module.
    """

    def __init__(self, hints: dict[str, Any], module: dict[str, Any]) -> None:
        super().__init__(hints)
        self._module = module

    def _prepare(self) -> None:
        from tf2_py._objects import hinted_names

        for name in hinted_names.__all__:
            self._module.setdefault(name, getattr(hinted_names, name))


class _LateFields(_Late):
    """The hints of a named tuple: its texts become types, because its module does not have the names."""

    def _prepare(self) -> None:
        from tf2_py._objects import hinted_names

        for name, hint in dict.items(self):
            if isinstance(hint, ForwardRef):
                self[name] = eval(hint.__forward_arg__, hinted_names.__dict__)


def resolve_late(cls: type[Any]) -> None:
    """Let the hints of a named tuple become types when somebody reads them."""
    cls.__annotations__ = cls.__new__.__annotations__ = _LateFields(cls.__annotations__)
