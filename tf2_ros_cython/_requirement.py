"""Importing this module raises ImportError, naming what to do, where tf2_ros cannot run."""

from tf2_ros_cython._ros import built, require_ros

require_ros()

_record = built()
# Of this project, as pyproject.toml says it; None where nothing was built, as in a fresh checkout.
__version__: str | None = None if _record is None else _record.VERSION
