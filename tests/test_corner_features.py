"""What is known when a corner of the rate envelope is chosen: what a turn tells, and what the wheels have to give."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from satid_gym.control.corners.choice import Choice
from satid_gym.control.craft import Craft
from satid_gym.core.observation import observed_std
from tests.test_corners import CORNERS


def choice(rng: np.random.Generator, waited: float) -> Choice:
    """At one of three corners with any rates, on a satellite of a full tensor."""
    edge = rng.normal(size=(3, 3))
    craft = Craft(
        inertia=(4.0 * np.eye(3) + 0.2 * (edge + edge.T))[None],
        momentum=rng.uniform(1.0, 2.0, (1, 3)),
        rate_limit=np.array([0.05]),
        noise=np.array([2e-5]),
    )
    seen = {
        "rate": rng.uniform(-1.0, 1.0, (1, 3)),
        "uncertainty": rng.uniform(-1.0, 1.0, (1, 6)),
        "control_authority": np.full((1, 3), 0.2),
        "inertia": rng.uniform(-0.1, 0.1, (1, 6)),
        "wheel_momentum": rng.uniform(-0.5, 0.5, (1, 3)),
    }
    given = dict.fromkeys(("wait_score", "fixes", "modes", "foreseen", "peak", "band"))
    corners = CORNERS[None, [0, 3, 7]]
    there = {"reverses": corners > 0.0, "waited": np.full((1, 3), waited)}
    return Choice(seen=seen, craft=craft, corners=corners, period=1.0, decisions=300, **there, **given)


@pytest.mark.parametrize("waited", [1.0, 40.0])
@pytest.mark.parametrize("whole", [False, True])
def test_a_turn_tells_as_much_as_a_measured_change_of_momentum_does(waited, whole):
    """Half the log of the determinant of the measurement's covariance with and without that of the inertia.

    Derivatives are differences of perturbed tensors; the correlations are at their places among those of 9 states.
    """
    rng = np.random.default_rng(5)
    asked = choice(rng, waited)
    factor = rng.normal(size=(9, 9)) + 2.0 * np.eye(9)
    covariance = factor @ factor.T
    correlation = covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    if whole:
        rows = [(r, c) for r in range(9) for c in range(r + 1, 9) if r >= 3 or c < 3]
        seen = {"state_uncertainty": np.zeros((1, 3)), "state_correlation": np.array([[correlation[i] for i in rows]])}
        asked = dataclasses.replace(asked, seen={**asked.seen, **seen})
    among = correlation[3:, 3:] if whole else np.eye(6)
    tensor, std = asked.craft.inertia[0], observed_std(asked.seen["uncertainty"][0])
    noise = 2e-5 * (1.0 / waited + 1.0 / 7.0)
    for decisions, most in ((np.inf, np.inf), (3.0, 0.6)):
        found = asked.gain(decisions)[0]
        for corner, gain in zip(asked.corners[0], found, strict=True):
            turn = np.clip(corner - asked.seen["rate"][0], -most, most)
            told = np.empty((3, 6))
            for k, (i, j) in enumerate([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]):
                change = np.zeros((3, 3))
                change[i, j] = change[j, i] = std[k] * np.sqrt(tensor[i, i] * tensor[j, j])
                told[:, k] = change @ turn / np.diag(tensor)
            ratio = np.linalg.det(noise * np.eye(3) + told @ among @ told.T) / noise**3
            np.testing.assert_allclose(gain, 0.5 * np.log(ratio) / 3.0, rtol=1e-9)


def test_a_covariance_that_rounding_has_spoilt_tells_nothing_below_zero():
    """Correlations of -1 among all pairs are of no covariance; what rounding makes is less far from one."""
    asked = choice(np.random.default_rng(5), 3.0)
    seen = {"state_uncertainty": np.zeros((1, 3)), "state_correlation": np.full((1, 18), -1.0)}
    found = dataclasses.replace(asked, seen={**asked.seen, **seen}).gain()
    assert np.isfinite(found).all()
    assert (found >= 0.0).all()


def test_load_and_fullness_are_those_of_euler_s_equation():
    """The torque that keeps a rate is omega x H; the wheels store what is left of H."""
    asked = choice(np.random.default_rng(6), 3.0)
    part, limit = asked.seen, 0.05
    scale = np.sqrt(np.outer(np.diag(asked.craft.inertia[0]), np.diag(asked.craft.inertia[0])))
    tensor = asked.craft.inertia[0].copy()
    for k, (i, j) in enumerate([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]):
        tensor[i, j] += scale[i, j] * part["inertia"][0, k]
        tensor[j, i] = tensor[i, j]
    total = tensor @ part["rate"][0] * limit + part["wheel_momentum"][0] * asked.craft.momentum[0]
    for i, corner in enumerate(asked.corners[0]):
        speeding = np.linalg.inv(tensor) @ np.cross(total, corner * limit) / limit  # limits a second, without torque
        np.testing.assert_allclose(asked.load[0, i], min(np.abs(speeding).max() / 0.2, 2.0), rtol=1e-12)
        left = np.abs(total - tensor @ corner * limit) / asked.craft.momentum[0]
        np.testing.assert_allclose(asked.fullness[0, i], left.max(), rtol=1e-12)
