"""What replaces the parts of ROS that a buffer uses, by the same names, if there is no ROS."""

import sys
from collections.abc import Callable
from typing import NoReturn

from tf2_ros_cython._presence import absence


class Shutdown:
    """The shutdown that ends a wait. Without ROS, only Ctrl-C ends one."""

    def __init__(self, core: object) -> None:
        pass

    def __call__(self) -> bool:
        """Return False, because there is no shutdown."""
        return False


def TransformFuture(*arguments: object) -> NoReturn:
    """Refuse to make a future, which is a class of rclpy."""
    raise absence("a future of a transform")


Changes = TransformFuture  # which takes such a future


def names_that_need_ros(module: str, *others: str) -> Callable[[str], NoReturn]:
    """
    Make the ``__getattr__`` of a module, which says of the names that it lacks what to install.

    :param others: names that need ROS, but are not in the module's ``__all__``.
    """

    def __getattr__(name: str) -> NoReturn:
        if name in (*sys.modules[module].__all__, *others):
            raise absence(f"{module}.{name}")
        raise AttributeError(f"module {module!r} has no attribute {name!r}")

    return __getattr__
