"""Turns of the body frame: those of an observation are those of the flight."""

from __future__ import annotations

import numpy as np
import pytest

from agents.training.turns import turns
from satid_gym import Pilot, ReactionWheels, SatInertiaIDEnv, draw_satellites

SETTINGS = {"observation": "body", "control": "rate", "include_covariance": True, "include_walk": True}
SATELLITE = draw_satellites([1], wheels=3)[0]


class _Recorder:
    """Policy that keeps what it observes, and commands rates that are given."""

    name, kind, observation, include_covariance, include_walk = "recorder", "scripted", "body", True, True

    def __init__(self, commands):
        self.commands = commands

    def reset(self, mission, seeds):
        self.layout, self.seen, self.left = mission.layout, [], iter(self.commands)

    def __call__(self, observation):
        self.seen.append(observation[0])
        return next(self.left)[None]


def _observed(satellite, rates, speeds, commands):
    """What a policy is shown of a flight with given readings."""
    policy = _Recorder(commands)
    pilot = Pilot(satellite, policy, control="rate")
    pilot.start(0.0, rates[0], speeds[0])
    for i in range(1, len(rates)):
        pilot.step(0.1 * i, rates[i], speeds[i])
    return policy.layout, np.array(policy.seen)


def test_a_flight_in_a_turned_frame_is_observed_as_the_turn_says():
    rng, wheels = np.random.default_rng(0), SATELLITE.wheels
    commands = rng.uniform(-0.6, 0.6, (13, 3))
    time = 0.1 * np.arange(121)[:, None]
    rates = 0.5 * SATELLITE.rate_limit * np.sin(time * [0.9, 0.7, 1.1] + [0.0, 1.0, 2.0])
    # the wheels take up what the body gives, about body axes: filters do not mind that rates are made up
    held = np.linalg.solve(wheels.axes * wheels.inertia, -(SATELLITE.inertia - wheels.rotor_inertia) @ rates.T).T
    speeds = held + SATELLITE.tachometer_noise_std * rng.standard_normal(rates.shape)
    rates = rates + SATELLITE.gyro_noise_std * rng.standard_normal(rates.shape)
    layout, observed = _observed(SATELLITE, rates, speeds, commands)
    assert len(observed) == len(commands)
    for turn in turns(layout)[::5]:
        rotation = np.zeros((3, 3))
        rotation[range(3), turn.axes] = turn.axis_signs
        sheet = {name: getattr(wheels, name) for name in ("inertia", "max_torque", "max_speed")}
        turned = SATELLITE.replace(
            inertia=rotation @ SATELLITE.inertia @ rotation.T,
            wheels=ReactionWheels(axes=rotation @ wheels.axes, **sheet),
        )
        _, seen = _observed(turned, rates @ rotation.T, speeds, turn.by_axis(commands))
        np.testing.assert_allclose(seen, turn.observed(observed), atol=1e-3)


def test_turns_are_a_group_of_24():
    layout = SatInertiaIDEnv(SATELLITE, **SETTINGS).problem.layout
    found = {tuple((turn.places * turn.signs + turn.signs).tolist()) for turn in turns(layout)}
    assert len(found) == 24
    x = np.random.default_rng(0).standard_normal((1, max(place.stop for place in layout.values())))
    one, other = turns(layout)[5], turns(layout)[17]
    both = one.observed(other.observed(x))
    assert any(np.allclose(both, turn.observed(x)) for turn in turns(layout))


def test_layouts_without_known_turns_are_refused():
    layout = SatInertiaIDEnv(SATELLITE).problem.layout
    with pytest.raises(ValueError, match='in the form "body"'):
        turns(layout)
