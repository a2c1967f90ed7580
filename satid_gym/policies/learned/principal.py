"""Networks for the full tensor, flown with a filter that estimates three moments.

What such a filter leaves out, the products of inertia, is shown to the network as nominal, uncorrelated, and known as
well as the two moments of its axes. That is a linear function of what is observed, and so a part of the first layer.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from satid_gym.core.observation import MODE_PARTS, layout, state_pairs
from satid_gym.estimators.inertia import PARAMETER_COUNT, PRODUCTS

if TYPE_CHECKING:
    from satid_gym.policies.learned.network import Network

_PRINCIPAL, _FULL = PARAMETER_COUNT["principal"], PARAMETER_COUNT["full"]


def fitted(network: Network, observed: dict[str, slice]) -> Network:
    """Network for observations of a layout, where it is one for the full tensor and they are of three moments.

    Any other network, or one for observations of another size, is given back as it is.
    """
    matrix, first = widening(observed), network.weights[0]
    if matrix is None or len(matrix) != first.shape[1]:
        return network
    weights = ((first @ matrix).astype(first.dtype), *network.weights[1:])
    return dataclasses.replace(network, weights=weights)


def widening(observed: dict[str, slice]) -> np.ndarray | None:
    """Matrix (wide, narrow) from observations in the form "body" of three moments to those of the full tensor.

    Args:
        observed: the layout of the former; None is returned for any other.
    """
    size = {name: place.stop - place.start for name, place in observed.items()}
    if "wheel_momentum" not in size or size["inertia"] != _PRINCIPAL:
        return None
    others = size.get("state_uncertainty", 0)
    wide = layout(
        0,
        _FULL,
        others,
        "body",
        size["modes"] // sum(MODE_PARTS.values()),
        size["command"],
        "attitude_age" in size,
        "inertia_walk" in size,
        ("sun" in size, "earth" in size),
        "window" in size,
    )
    matrix = np.zeros((max(p.stop for p in wide.values()), max(p.stop for p in observed.values())))
    for name, place in wide.items():
        block, count = matrix[place, observed[name]], size[name]
        if name == "inertia":
            block[:_PRINCIPAL] = np.eye(_PRINCIPAL)
        elif name == "uncertainty":
            block[:_PRINCIPAL] = np.eye(_PRINCIPAL)
            for row, axes in zip(block[_PRINCIPAL:], PRODUCTS, strict=True):
                row[list(axes)] = 0.5
        elif name == "correlation":
            for r in range(3):
                block[_FULL * r : _FULL * r + _PRINCIPAL, _PRINCIPAL * r : _PRINCIPAL * (r + 1)] = np.eye(_PRINCIPAL)
        elif name == "state_correlation":
            place_of = {pair: i for i, pair in enumerate(_pairs(_PRINCIPAL, others))}
            for i, pair in enumerate(_pairs(_FULL, others)):
                if pair in place_of:
                    block[i, place_of[pair]] = 1.0
        else:
            block[:] = np.eye(count)
    return matrix


def _pairs(p: int, others: int) -> list[tuple[int, int]]:
    """Pairs of states of `state_correlation` in order, each by its number where all products are estimated."""
    number = [*range(3 + p), *range(3 + _FULL, _FULL + others)]
    return [(number[r], number[c]) for r, c in state_pairs(p, others)]
