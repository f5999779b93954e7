"""What replaces the parts of ROS that a buffer uses, by the same names, if there is no ROS."""

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
