"""Inertia parameters theta: moments and products of a tensor, and back."""

from __future__ import annotations

from typing import Literal

import numpy as np

Parameters = Literal["principal", "full"]


PARAMETER_COUNT: dict[Parameters, int] = {"principal": 3, "full": 6}


PRODUCTS = ((0, 1), (0, 2), (1, 2))  # rows and columns of parameters 4 to 6


PRODUCT_MIN = 3e-5  # of the geometric mean of two moments: below it a filter of three moments stays consistent


def inertia_parameters(tensor: np.ndarray, parameters: Parameters) -> np.ndarray:
    """theta (p,) of inertia tensors (..., 3, 3): moments, and for "full" the products xy, xz, yz."""
    theta = [tensor[..., i, i] for i in range(3)]
    if parameters == "full":
        theta += [tensor[..., i, j] for i, j in PRODUCTS]
    return np.stack(theta, axis=-1)


def inertia_tensors(theta: np.ndarray) -> np.ndarray:
    """Tensors (..., 3, 3) of inertia parameters theta (..., p); the products that p = 3 leaves out are 0."""
    tensor = np.zeros((*theta.shape[:-1], 3, 3))
    for i in range(3):
        tensor[..., i, i] = theta[..., i]
    for k, (i, j) in enumerate(PRODUCTS[: theta.shape[-1] - 3]):
        tensor[..., i, j] = tensor[..., j, i] = theta[..., 3 + k]
    return tensor


def products_of_inertia(tensor: np.ndarray, moments: np.ndarray) -> str:
    """The products of inertia that a filter of three moments would miss, in words; "" where there are none.

    Args:
        tensor: (3, 3) kg m^2, body frame.
        moments: (3,) kg m^2 about the body axes, that products are compared with.
    """
    found = [(i, j) for i, j in PRODUCTS if abs(tensor[i, j]) > PRODUCT_MIN * np.sqrt(moments[i] * moments[j])]
    names = ", ".join(f"J{'xyz'[i]}{'xyz'[j]} = {tensor[i, j]:.4g}" for i, j in found)
    return f"{names} kg m^2" if found else ""
