"""Compare tensors as `torch.testing.assert_close` does, which imports SymPy for seconds when it is first called."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from torch import Tensor

__all__ = ["assert_close"]

# Of torch: relative and absolute tolerance by the bytes of a number (half, single and double precision).
_TOLERANCES = {2: (1e-3, 1e-5), 4: (1.3e-6, 1e-5), 8: (1e-7, 1e-7)}


def assert_close(actual: Tensor, expected: Tensor, *, rtol: float | None = None, atol: float | None = None) -> None:
    """Fail unless both have the same shape, dtype and, within the tolerances (by default torch's), the same values."""
    assert (actual.shape, actual.dtype) == (expected.shape, expected.dtype)
    if not actual.dtype.is_floating_point:
        assert actual.equal(expected)
        return
    if rtol is None and atol is None:
        rtol, atol = _TOLERANCES[actual.element_size()]
    found, wanted = (each.detach().cpu().double().numpy() for each in (actual, expected))
    np.testing.assert_allclose(found, wanted, rtol=rtol or 0.0, atol=atol or 0.0, equal_nan=False)
