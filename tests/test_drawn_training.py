"""Training on drawn satellites: what is trained on, what is validated on, what each round of imitation flies."""

from __future__ import annotations

import numpy as np
import pytest

from agents.training.imitation import ImitationSettings
from agents.training.ppo import PPOSettings
from agents.training.run import SCORES, condensed
from agents.training.train import named
from satid_gym.drawn_satellite import draw_satellites
from satid_gym.evaluation import FIRST_SEED
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies import find
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policy import missions, observation_settings, only_mission
from satid_gym.problem import problem
from satid_gym.satellite import SATELLITES
from tests.cases import cases


def test_validation_flies_other_satellites_than_training():
    settings = PPOSettings(satellite="drawn", drawn=8, drawn_wheels=5, wheel_scales=(1.0, 0.5))
    pool, validated = settings.pool(), settings.satellites
    assert {satellite.wheels.count for satellite in (*pool, *validated)} == {5}
    assert len(pool) == 16
    assert not {satellite.name for satellite in pool} & {satellite.name for satellite in validated}
    assert all(int(satellite.name.removeprefix("drawn_")) >= FIRST_SEED["validation"] for satellite in validated)


def test_rounds_of_imitation_share_drawn_satellites():
    settings = ImitationSettings(satellite="drawn", drawn=11, rounds=3, episodes=1, wheel_scales=(1.0,), tracked=True)
    places = [place for i in range(3) for place in settings.places(i)]
    assert sorted(places) == list(range(11))
    assert list(ImitationSettings(satellite="cubesat").places(4)) == [0, 1]  # with each factor on its wheels


@cases(
    ("scales", "rounds", "drawn"), [((1.0, 0.1), 6, 48), ((1.0, 0.1), 4, 35), ((1.0, 0.5, 0.1), 3, 24), ((1.0,), 4, 19)]
)
def test_every_inertia_mode_is_flown_with_every_speed_of_the_wheels(scales, rounds, drawn):
    """Modes once went by places in the pool, whose parity is that of the factor on the wheels."""
    given = {"satellite": "drawn", "drawn": drawn, "rounds": rounds, "wheel_scales": scales, "episodes": 1}
    settings, pool = ImitationSettings(**given), []
    for i in range(rounds):
        pool += settings.places(i)
        flown = {(settings.modes_at(place, i), place % len(scales)) for place in settings.places(i)}
        assert flown == {((mode,), k) for mode in INERTIA_MODES for k in range(len(scales))}
    assert sorted(pool) == list(range(len(settings.pool())))


def test_a_known_satellite_flies_every_mode_in_every_round():
    assert ImitationSettings(satellite="cubesat").modes_at(1, 3) == INERTIA_MODES


@pytest.mark.parametrize("name", ["universal", "universal_imitation"])
def test_named_settings_see_the_same(name):
    settings = named(name)
    assert settings.satellite == "drawn"
    assert settings.actions == "rate"


def test_many_satellites_are_shown_as_one():
    rows = [{"satellite": str(i), **dict.fromkeys(SCORES, 10.0**i)} for i in range(7)]
    (row,) = condensed(rows)
    assert row["final_error"] == pytest.approx(1e3)  # geometric
    assert row["nees"] == pytest.approx(np.mean(10.0 ** np.arange(7)))
    assert condensed(rows[:3]) == rows[:3]


@pytest.mark.parametrize(("slews", "period"), [(0.0, 6.0), (1.0, 6.0), (10.0, 9.0)])
def test_a_slow_satellite_gets_a_longer_period(slews, period):
    """From rest to the limit in 0.9 s about the slowest axis: 4.5 kg m^2 x 0.02 rad/s / 0.1 N m."""
    satellite = SATELLITES["microsat"].replace(inertia=[4.5, 4.0, 3.0], rate_limit=0.02)
    (mission,) = missions(problem(satellite, "static", control="rate"))
    policy = RateSquarePolicy(6.0, 3.0, slews)
    policy.reset(mission, [0])
    shown = np.zeros((1, max(place.stop for place in mission.layout.values())), np.float32)
    sides = np.array([np.sign(policy(shown)[0, 0]) for _ in range(18)])
    expected = np.where(np.mod((np.arange(18) + 0.5) / period, 1.0) < 0.5, 1.0, -1.0)
    np.testing.assert_array_equal(sides, expected)


@pytest.mark.parametrize("wheels", range(3, 9))
@pytest.mark.parametrize("parameters", ["principal", "full"])
@pytest.mark.parametrize("name", ["universal", "rigid_tour"])
def test_the_shipped_policies_take_any_number_of_wheels_and_both_filters(wheels, parameters, name):
    policy = find(name)
    (satellite,) = draw_satellites([0], wheels=wheels)
    if parameters == "principal":
        satellite = satellite.replace(inertia=np.diag(np.diag(satellite.inertia)))
    posed = problem(satellite, "static", control="rate", **observation_settings(policy))
    assert posed.parameters == parameters
    policy.reset(only_mission(posed), [0, 1])
    action = policy(np.ones((2, max(place.stop for place in posed.layout.values())), np.float32))
    assert action.shape == (2, 3)
    assert (np.abs(action) <= 1.0).all()
