"""Family of torque profiles of very different information at the same mean square torque."""

from __future__ import annotations

from functools import partial

import numpy as np

from satid_gym.policies.scripted import ScriptedPolicy, Signal, staggered_square
from satid_gym.profiles import PROFILES, prbs
from satid_gym.scenario import Scenario


def phased_sine(time: np.ndarray, *, frequency: float, horizon: float | None = None) -> np.ndarray:
    """One tone of `frequency`, Hz, a third of a period apart on the three axes; (N, 3) for time (N,) s."""
    return np.sin(2.0 * np.pi * (frequency * time[:, None] + np.arange(3) / 3.0))


def one_axis_at_a_time(time: np.ndarray, *, period: float, horizon: float | None = None) -> np.ndarray:
    """Square wave that moves to the next axis after each `period`, s; (N, 3) for time (N,) s."""
    side = np.where(np.mod(time / period + 0.25, 1.0) < 0.5, 1.0, -1.0)
    axis = np.floor(time / period).astype(int) % 3
    return side[:, None] * (axis[:, None] == np.arange(3))


FAMILY: dict[str, Signal] = {
    **PROFILES,
    "prbs_other": partial(prbs, seed=2),
    **{f"staggered_{p}s": partial(staggered_square, period=float(p)) for p in (12, 36, 84)},
    **{f"phased_{m}mHz": partial(phased_sine, frequency=1e-3 * m) for m in (5, 20, 50)},
    "one_axis_30s": partial(one_axis_at_a_time, period=30.0),
}


def matched(name: str, torque: float, scenario: Scenario) -> ScriptedPolicy:
    """Profile of the family, scaled so that its root mean square torque over axes and horizon is `torque`.

    Args:
        name: name among `FAMILY`.
        torque: about a body axis, as a fraction of the weakest wheel's torque limit.
        scenario: with the horizon and the decision period.
    """
    time = scenario.decision_period * np.arange(scenario.decisions)
    signal = FAMILY[name]
    strength = np.sqrt(np.mean(np.square(signal(time, horizon=scenario.horizon))))
    return ScriptedPolicy(name, signal, torque / float(strength))
