"""Replace what a buffer uses of ROS if there is no ROS, and explain the names that need it."""

from collections.abc import Collection
from typing import Any, NoReturn

from tf2_ros_cython._presence import absence


def leave_out_ros(namespace: dict[str, Any], others: Collection[str] = ()) -> None:
    """
    Let a module offer what it has: ``import *`` gives that, and its other names say what to install.

    :param namespace: the globals of the module, with all the names that it has with ROS in ``__all__``.
    :param others: more such names, which ``import *`` does not import.
    """
    module, offered = namespace["__name__"], namespace["__all__"]
    lacking = {name for name in (*offered, *others) if name not in namespace}

    def __getattr__(name: str) -> NoReturn:
        if name in lacking:
            raise absence(f"{module}.{name}")
        raise AttributeError(f"module {module!r} has no attribute {name!r}")

    namespace["__getattr__"] = __getattr__
    namespace["__all__"] = [name for name in offered if name not in lacking]


# What a buffer uses of ROS, by the same names.


class Shutdown:
    """The shutdown that ends a wait. Without ROS, only Ctrl-C ends one."""

    def __init__(self, core: object) -> None:
        pass

    def happened(self) -> bool:
        """Return False, because there is no shutdown."""
        return False


def attribute_changed(buffer: object) -> None:
    """Do nothing, because no receiver calls a buffer's methods."""


def insert_arrived(buffer: object) -> None:
    """Do nothing, because nothing arrives."""


def TransformFuture(*arguments: object) -> NoReturn:
    """Refuse to make a future, which is a class of rclpy."""
    raise absence("a future of a transform")


def Changes(*arguments: object) -> NoReturn:
    """Refuse to wait for changes, which takes such a future."""
    raise absence("waiting for changes of a transform")
