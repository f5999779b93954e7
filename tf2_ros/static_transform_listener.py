"""Owns nothing: the module from which tf2's StaticTransformListener is imported."""

# Before the imports below fail without a word of advice.
from tf2_ros_cython import _requirement  # noqa: F401

# isort: split

from tf2_ros.transform_listener import DEFAULT_STATIC_TF_TOPIC, DEFAULT_TF_TOPIC, StaticTransformListener

__all__ = ["DEFAULT_STATIC_TF_TOPIC", "DEFAULT_TF_TOPIC", "StaticTransformListener"]
