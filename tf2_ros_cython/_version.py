"""Owns the version of this project, as pyproject.toml says it."""

from tf2_ros_cython._ros import built

_record = built()
# Unknown where nothing was built, as in a fresh checkout.
__version__: str = "unknown" if _record is None else _record.VERSION
