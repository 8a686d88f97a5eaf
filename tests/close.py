"""Compare numbers as `torch.testing.assert_close` does, which imports SymPy for seconds when it is first called."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import Tensor

__all__ = ["assert_close"]

# Of torch: relative and absolute tolerance by the bytes of a number (half, single and double precision).
_TOLERANCES = {2: (1e-3, 1e-5), 4: (1.3e-6, 1e-5), 8: (1e-7, 1e-7)}


def assert_close(
    actual: Tensor | NDArray[Any],
    expected: Tensor | NDArray[Any],
    *,
    rtol: float | None = None,
    atol: float | None = None,
) -> None:
    """Fail unless both have the same shape, dtype and, within the tolerances (by default torch's), the same values."""
    found, wanted = _array(actual), _array(expected)
    assert (found.shape, found.dtype) == (wanted.shape, wanted.dtype)
    if found.dtype.kind != "f":
        assert np.array_equal(found, wanted)
        return
    if rtol is None and atol is None:
        rtol, atol = _TOLERANCES[actual.dtype.itemsize]
    np.testing.assert_allclose(
        found.astype(np.float64), wanted.astype(np.float64), rtol=rtol or 0.0, atol=atol or 0.0, equal_nan=False
    )


def _array(numbers: Tensor | NDArray[Any]) -> NDArray[Any]:
    """Return numbers as an array; numpy knows no bfloat16, all of which are single-precision numbers."""
    if isinstance(numbers, np.ndarray):
        return numbers
    tensor = numbers.detach().cpu()
    return np.asarray((tensor.float() if str(tensor.dtype) == "torch.bfloat16" else tensor).numpy())
