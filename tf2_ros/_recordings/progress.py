"""Owns the bars that show how far long work is."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tf2_ros._recordings.problems import needs

__all__ = ["progress_bar"]

BAR_AFTER_S = 1.0


@contextmanager
def progress_bar(
    name: str, total: int | None, unit: str, progress: bool | None
) -> Iterator[Callable[[int], object] | None]:
    """
    Show a bar during a ``with`` statement; gives what to call with how many more are done, or None.

    :param progress: None: if standard error is a terminal, after one second.
    :raises ModuleNotFoundError: ``progress`` is True, and tqdm is not installed.
    """
    if progress is False:
        yield None
        return
    try:
        from tqdm.auto import tqdm
    except ModuleNotFoundError as missing:
        if progress is None:
            yield None
            return
        raise needs("tqdm", "bag") from missing
    # Here None means: not where stderr is no terminal.
    disable, delay = (None, BAR_AFTER_S) if progress is None else (False, 0.0)
    with tqdm(total=total, desc=name, unit=unit, delay=delay, disable=disable) as bar:
        yield None if bar.disable else bar.update
