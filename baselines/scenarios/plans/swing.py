"""Plan of the oracle where there is a star tracker: `swing_and_stop`, told the sky, with settings of each episode."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from satid_gym.policies.swing_and_stop import SIDES, SwingAndStopPolicy
from satid_gym.policy import Mission
from satid_gym.vector import SatInertiaIDVectorEnv

_TYPICAL = {"swing": 12.0, "look": 3.0, "clearance": 0.1, "amplitude": 0.8}
_SIZES = {"swing": 1, "look": 1, "clearance": 1, "amplitude": 3, "preference": len(SIDES)}
_EDGES = np.cumsum([0, *_SIZES.values()]).tolist()
_PLACES = {name: slice(*_EDGES[i : i + 2]) for i, name in enumerate(_SIZES)}


def with_true_sky(env: SatInertiaIDVectorEnv, observation: np.ndarray) -> np.ndarray:
    """Observations in which the directions of Sun and Earth are true, also where the attitude is not known."""
    plants, told = env.fleet.rows.plants, observation.copy()
    to_body = Rotation.from_quat(plants["attitude"]).inv()
    angle = plants["orbit_rate"] * plants["time"]
    sky = {"sun": plants["tracker"]["sun"], "earth": np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])}
    for name, direction in sky.items():
        if name in env.problem.layout:
            told[:, env.problem.layout[name]] = to_body.apply(direction)
    return told


class SwingPlan(SwingAndStopPolicy):
    """`swing_and_stop` with settings of its own for each episode, those of the oracle's search.

    Args:
        points: (N, 14) where the search looks: logarithms of settings over typical ones, three of them the axes'
            amplitudes, and of how much each side to swing to is preferred.
    """

    size = _EDGES[-1]

    def __init__(self, points: np.ndarray) -> None:
        super().__init__()
        given = {name: typical * np.exp(points[:, _PLACES[name]]) for name, typical in _TYPICAL.items()}
        self.swing, self.look = given["swing"][:, 0], given["look"][:, 0]  # type: ignore[assignment]
        self.clearance = given["clearance"][:, 0]  # type: ignore[assignment]
        self.amplitude = np.minimum(given["amplitude"], 1.0)  # type: ignore[assignment]
        self._given_preference = points[:, _PLACES["preference"]]

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare, each episode with its own preference of sides."""
        super().reset(mission, seeds)
        self._preference = self._given_preference

    def told(self, env: SatInertiaIDVectorEnv, observation: np.ndarray) -> np.ndarray:
        """What it observes, with the true sky."""
        return with_true_sky(env, observation)
