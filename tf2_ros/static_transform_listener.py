"""The module from which programs for tf2 import StaticTransformListener."""

# Imported first, because it explains what to install if the imports below fail.
from tf2_ros_cython import _requirement  # noqa: F401

# isort: split

from tf2_ros.transform_listener import DEFAULT_STATIC_TF_TOPIC, DEFAULT_TF_TOPIC, StaticTransformListener

__all__ = ["DEFAULT_STATIC_TF_TOPIC", "DEFAULT_TF_TOPIC", "StaticTransformListener"]
