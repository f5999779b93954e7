import numpy as np
from numpy.typing import NDArray

def normalise(rotations: NDArray[np.float64]) -> int: ...
