"""Plan of the oracle where panels ring: `shaped_square`, told the true ones, with settings of each episode."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.core.observation import BOUND, MODE_PARTS, MODE_PLACES
from satid_gym.policies.shaped_square import ShapedSquarePolicy
from satid_gym.policy import Mission
from satid_gym.vector import SatInertiaIDVectorEnv

_TYPICAL = {"period": 24.0, "share": 0.6, "dwell": 0.5, "amplitude": 0.8}
_SIZES = {"period": 3, "share": 1, "dwell": 1, "amplitude": 1, "shift": 1}
_EDGES = np.cumsum([0, *_SIZES.values()]).tolist()
_PLACES = {name: slice(*_EDGES[i : i + 2]) for i, name in enumerate(_SIZES)}
_FREQUENCY = 1  # place in the drawn scale of an oscillator: mass, frequency, damping
_KNOWN = -BOUND  # observed standard deviation of what is known exactly


def with_true_modes(env: SatInertiaIDVectorEnv, observation: np.ndarray) -> np.ndarray:
    """Observations in which frequency and deflection of the only mode, that of one tank or mirrored pair, are true.

    What the rotation pulls it to goes with the frequency.

    Its deflection is that of the pair's mean times the limit of eta over that of angle or travel; the mass in both is
    the filter's, and what a policy does with their ratio is free of it.
    """
    rows, places = env.fleet.rows, MODE_PLACES
    modes, limit, told = rows.beliefs["modes"], rows.tasks["deflection_limit"], observation.copy()
    part = told[:, env.problem.layout["modes"]].reshape(len(told), -1, sum(MODE_PARTS.values()))
    o, nominal = rows.plants["oscillators"], modes["frequency"][:, 0]
    if np.isfinite(limit).all():
        rung = np.linalg.norm(modes["coupling"][:, 0], axis=1) * rows.tasks["rate_limit"]
        growth = np.linalg.norm(modes["d"][:, 0], axis=1) / np.linalg.norm(modes["coupling"][:, 0], axis=1)
        eta = modes["limit"][:, 0] * growth / limit[:, 0]  # by angle or travel, at the mass that the filter believes
        part[:, 0, places["deflection"]] = o["deflection"].mean(axis=1) * eta * nominal / rung
        part[:, 0, places["deflection_rate"]] = o["speed"].mean(axis=1) * eta / rung
    cycles = nominal * o["scale"][:, 0, _FREQUENCY] * env.problem.scenario.decision_period / (2.0 * np.pi)
    pull = slice(places["centrifugal"], places["centrifugal"] + MODE_PARTS["centrifugal"])
    part[:, 0, pull] *= (part[:, [0], places["frequency"]] / cycles[:, None]) ** 2
    part[:, 0, places["frequency"]], part[:, 0, places["frequency_std"]] = cycles, _KNOWN
    told[:, env.problem.layout["modes"]] = part.reshape(len(told), -1)
    return told


class ShapedPlan(ShapedSquarePolicy):
    """`shaped_square` with settings of its own for each episode, those of the oracle's search.

    Args:
        points: (N, 7) where the search looks: logarithms of settings over typical ones, three of them the axes'
            periods, and a shift of phase in quarters of a period.
    """

    size = _EDGES[-1]

    def __init__(self, points: np.ndarray) -> None:
        super().__init__(caution=0.0)
        given = {name: typical * np.exp(points[:, _PLACES[name]]) for name, typical in _TYPICAL.items()}
        self.period, self.dwell = given["period"], given["dwell"]  # type: ignore[assignment]
        self.share = np.minimum(given["share"][:, 0], 1.0)  # type: ignore[assignment]
        self.amplitude = np.minimum(given["amplitude"], 1.0)  # type: ignore[assignment]
        self._shift = points[:, _PLACES["shift"]]

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare, each episode with its own phase."""
        super().reset(mission, seeds)
        self._phase += 0.25 * self._shift
        self._begins = True

    def told(self, env: SatInertiaIDVectorEnv, observation: np.ndarray) -> np.ndarray:
        """What it observes, with true modes; the first observation has their data sheet, which it notes."""
        if self._begins:
            self._begins = False
            return observation
        return with_true_modes(env, observation)
