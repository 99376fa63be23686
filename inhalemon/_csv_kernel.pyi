import numpy as np
from numpy.typing import NDArray

from inhalemon.values import FloatArray

def parse_rows(
    text: bytes, sensor_column: int, max_line: int, values: FloatArray, is_lever: NDArray[np.uint8]
) -> bool: ...
