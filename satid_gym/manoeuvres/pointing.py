"""Pointing of a manoeuvre: angle turned, and distance of boresights from the directions they avoid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from satid_gym.manoeuvres.request import KeepOut


def attitudes(rates: np.ndarray, period: float) -> np.ndarray:
    """Attitudes (K, D + 1, 4), body to first body frame, scalar last.

    Args:
        rates: (K, D + 1, 3) at the decisions' edges, linear between, rad/s.
        period: of a decision, s.
    """
    turns = 0.5 * period * (rates[:, 1:] + rates[:, :-1])
    out = np.empty((*rates.shape[:2], 4))
    attitude = Rotation.identity(len(rates))
    out[:, 0] = attitude.as_quat()
    for d in range(turns.shape[1]):
        attitude = attitude * Rotation.from_rotvec(turns[:, d])
        out[:, d + 1] = attitude.as_quat()
    return out


def turned(attitude: np.ndarray) -> np.ndarray:
    """Angle (...) from the first attitude, rad, of attitudes (..., 4)."""
    return 2.0 * np.arctan2(np.linalg.norm(attitude[..., :3], axis=-1), np.abs(attitude[..., 3]))


def separations(attitude: np.ndarray, keep_outs: Sequence[KeepOut]) -> np.ndarray:
    """Angles (..., k) of each boresight from what it avoids, rad, for attitudes (..., 4) as those of `attitudes`."""
    out = np.empty((*attitude.shape[:-1], len(keep_outs)))
    rotation = Rotation.from_quat(attitude.reshape(-1, 4))
    for k, keep_out in enumerate(keep_outs):
        pointing = rotation.apply(keep_out.boresight).reshape(*attitude.shape[:-1], 3)
        out[..., k] = keep_out.separation(pointing)
    return out
