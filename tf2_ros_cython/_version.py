"""The version of this installation, as the build recorded it."""

try:
    from tf2_ros_cython._built import VERSION as __version__
except ModuleNotFoundError:
    __version__ = "unknown"  # in a checkout that was not built

__all__ = ["__version__"]
