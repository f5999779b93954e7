# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""List what is assumed of rclpy that it does not promise, and report what does not hold."""

from collections.abc import Callable
from types import CodeType
from typing import Any

from tf2_py._objects import log

_LACKING = object()

ROWS: "list[Assumption]" = []  # those of all modules that were imported
# Names the release of rclpy; set by tf2_ros, which knows it.
release: Callable[[], str] = lambda: "this rclpy"  # noqa: E731


class Assumption:
    """
    A row of a module's table.

    :param used: what is used of rclpy.
    :param probe: whether it holds, asked on demand only; one that raises says no. It makes no context of
        rclpy, which in rmw_zenoh waits for a router.
    :param lost: what users lose where it does not hold: a sentence.
    """

    def __init__(self, used: str, probe: Callable[[], object], lost: str) -> None:
        self.used, self.probe, self.lost = used, probe, lost
        self.is_reported = False
        ROWS.append(self)

    def holds(self) -> bool:
        """Ask the probe."""
        try:
            return bool(self.probe())
        except Exception:  # a release that nobody knows may raise anything
            return False

    def report(self) -> None:
        """Log once that it does not hold; to be called when the slower way is used."""
        if not self.is_reported:
            self.is_reported = True
            text = f"{self.used}: {release()} differs from the releases that were tested: {self.lost}"
            log.logger("tf2_ros").warning(text)


class Attribute(Assumption):
    """
    An attribute of rclpy's objects.

    :param kind: their class.
    :param names: of the attribute, in one release or another, with spaces between them.
    :param types: of its values.
    """

    def __init__(self, kind: type, names: str, types: type | tuple[type, ...], lost: str) -> None:
        self.kind, self.names, self.types = kind, names.split(), types
        super().__init__(f"{kind.__name__}.{' or '.join(self.names)}", self._exists, lost)

    def _exists(self) -> bool:
        return any(hasattr(self.kind, name) or uses(self.kind, name) for name in self.names)

    def of(self, one: object, otherwise: Any = None) -> Any:
        """Get the value; ``otherwise`` if the object lacks it, which is reported if its class is rclpy's."""
        for name in self.names:
            value = attempt(_LACKING, getattr, one, name, _LACKING)
            if isinstance(value, self.types):
                return value
        if issubclass(type(one), self.kind):  # a mock is only an instance of it
            self.report()
        return otherwise


def attempt(otherwise: Any, call: Callable[..., Any], *arguments: object) -> Any:
    """
    Call what may raise anything in a release that nobody knows; ``otherwise`` if it raises twice.

    An error that it raises only once may be that of a signal handler, which belongs to the program.
    """
    try:
        return call(*arguments)
    except Exception:
        try:
            call(*arguments)
        except Exception:
            return otherwise
        raise


def uses(kind: type, *names: str) -> bool:
    """Whether methods of a class, or functions in them, use all of these attributes or functions."""
    codes = [code for one in vars(kind).values() if (code := getattr(one, "__code__", None))]
    used: set[str] = set()
    for code in codes:  # grows
        used.update(code.co_names)
        codes += [inner for inner in code.co_consts if isinstance(inner, CodeType)]
    return used.issuperset(names)


def broken() -> list[str]:
    """Probe the rows of all tables; describe those that do not hold, which are then not logged."""
    for row in ROWS:
        row.is_reported = True  # probes use what reports
    return [f"{row.used}: {row.lost}" for row in ROWS if not row.holds()]
