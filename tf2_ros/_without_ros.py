"""Owns what tf2_ros is without ROS: what stands for ROS in a buffer, and what the other names say."""

from collections.abc import Collection
from typing import Any, NoReturn

from tf2_ros_cython._presence import absence

__all__ = [
    "RecheckingFuture",
    "Shutdown",
    "TransformFuture",
    "attribute_changed",
    "jump_text",
    "leave_out_ros",
]


def leave_out_ros(namespace: dict[str, Any], others: Collection[str] = ()) -> None:
    """
    Let a module offer what it has: ``import *`` gives that, and its other names say what to install.

    :param namespace: the globals of the module, with all the names that it has with ROS in ``__all__``.
    :param others: more such names, which ``import *`` does not give.
    """
    module, offered = namespace["__name__"], namespace["__all__"]
    lacking = {name for name in (*offered, *others) if name not in namespace}

    def __getattr__(name: str) -> NoReturn:
        if name in lacking:
            raise absence(f"{module}.{name}")
        raise AttributeError(f"module {module!r} has no attribute {name!r}")

    namespace["__getattr__"] = __getattr__
    namespace["__all__"] = [name for name in offered if name not in lacking]


# What a buffer uses of ROS, by the names that it has there.


class Shutdown:
    """The shutdown that ends a wait: there is none, only Ctrl-C."""

    def __init__(self, core: object) -> None:
        pass

    def happened(self) -> bool:
        """Whether it was: never."""
        return False


def attribute_changed() -> None:
    """No receiver calls a buffer's methods."""


def TransformFuture(*arguments: object) -> NoReturn:
    """A future is rclpy's."""
    raise absence("a future of a transform")


RecheckingFuture = TransformFuture


def jump_text(time_jump: object) -> NoReturn:
    """A clock that jumps is rclpy's."""
    raise absence("a clock that jumps")
