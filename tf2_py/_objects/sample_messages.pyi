from typing import Any

import numpy as np
from numpy.typing import NDArray

def serialize_samples(
    names: list[bytes],
    rows: NDArray[np.int64],
    children: NDArray[np.uint32],
    parents: NDArray[np.uint32],
    stamps: NDArray[np.int64],
    transforms: NDArray[np.float64],
) -> bytes: ...

class SampleReader:
    def __init__(self, names: list[bytes]) -> None: ...
    def read(self, data: bytes) -> None: ...
    def arrays(self) -> tuple[Any, Any, Any, Any]: ...
