"""Relative error against time, over the episodes of a cell: the median, and the band that holds 80 % of them."""

from __future__ import annotations

import numpy as np

QUANTILES = {"low": 0.1, "median": 0.5, "high": 0.9}


def error_bands(error: np.ndarray) -> dict[str, list[float]]:
    """Quantiles over the episodes of an error (T, N), at each of its T decisions."""
    rows = np.quantile(error, list(QUANTILES.values()), axis=1)
    return {name: rounded(row) for name, row in zip(QUANTILES, rows, strict=True)}


def rounded(values: np.ndarray, digits: int = 3) -> list[float]:
    """Numbers with as many significant digits as a chart can show, so that the page stays small."""
    return [float(f"{value:.{digits}g}") for value in values.tolist()]
