"""Types of arrays by their elements, for annotations; a docstring says their shapes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
SingleArray = NDArray[np.float32]
BoolArray = NDArray[np.bool_]
ByteArray = NDArray[np.uint8]
CountArray = NDArray[np.uint16]
FlagArray = NDArray[np.uint32]
IntArray = NDArray[np.int64]
IndexArray = NDArray[np.intp]
AnyIntArray = NDArray[np.integer[Any]]
TableArray = NDArray[np.void]
AnyArray = NDArray[Any]
