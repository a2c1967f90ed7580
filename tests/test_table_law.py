"""Inertia laws of one's own: tables and functions, in every form of the environment."""

from __future__ import annotations

import numpy as np
import pytest

from satid_gym import InertiaLaw, SatInertiaIDEnv, SatInertiaIDVectorEnv
from satid_gym.laws import INERTIA_MODES, KNOTS_MAX
from satid_gym.plants import law_inertia
from tests.cases import cases

FUEL = InertiaLaw("table", times=(20.0, 60.0, 60.5, 200.0), values=(1.0, 0.9, 1.1, 1.0), name="fuel")
BOOM = InertiaLaw("table", times=(0.0, 50.0), values=[(0.0, 0.0, 0.0), (0.5, 0.4, 0.1)])


def flown(env, decisions, seed=3):
    """True inertia (decisions + 1, 3, 3) and last observation of an episode under a square wave."""
    observation, info = env.reset(seed=seed)
    truth = [info["inertia_true"]]
    for i in range(decisions):
        action = np.full(env.action_space.shape, 0.2 if i % 20 < 10 else -0.2, np.float32)
        observation, *_, info = env.step(action)
        truth.append(info["inertia_true"])
    return np.array(truth), observation


def test_an_environment_flies_factors_of_the_drawn_inertia():
    truth, _ = flown(SatInertiaIDEnv(inertia=FUEL), 80)
    factor = np.interp(np.arange(81.0), FUEL.times, FUEL.values)
    np.testing.assert_allclose(truth, factor[:, None, None] * truth[0], rtol=1e-12)
    nominal = SatInertiaIDEnv().problem.satellites[0].inertia
    assert not np.allclose(truth[0], nominal), "drawn about nominal, as for other laws"


def test_an_environment_adds_tensors_to_the_drawn_inertia():
    truth, _ = flown(SatInertiaIDEnv(inertia=BOOM), 60)
    share = np.minimum(np.arange(61.0) / 50.0, 1.0)
    np.testing.assert_allclose(truth - truth[0], share[:, None, None] * np.diag([0.5, 0.4, 0.1]), atol=1e-12)


def test_a_table_of_ones_is_the_static_law():
    """The same draws, truth and noise: a table takes no random number of its own and costs no precision."""
    ones = InertiaLaw("table", times=(0.0, 10.0, 300.0), values=(1.0, 1.0, 1.0))
    static, table = (flown(SatInertiaIDEnv(inertia=law), 40) for law in ("static", ones))
    np.testing.assert_allclose(table[0], static[0], rtol=1e-12)
    np.testing.assert_allclose(table[1], static[1], rtol=1e-5, atol=1e-6)


def test_the_vector_environment_flies_what_the_single_one_does():
    env = SatInertiaIDVectorEnv(3, inertia=FUEL)
    env.reset(seed=3)
    for i in range(30):
        _, _, _, _, infos = env.step(np.full((3, 3), 0.2 if i % 20 < 10 else -0.2, np.float32))
    for i in range(3):
        truth, _ = flown(SatInertiaIDEnv(inertia=FUEL), 30, seed=3 + i)
        np.testing.assert_array_equal(infos["inertia_true"][i], truth[-1])


def test_an_episode_of_another_law_in_an_environment_with_a_table():
    env = SatInertiaIDEnv(inertia=FUEL)
    _, info = env.reset(seed=1, options={"inertia": "static"})
    for _ in range(30):
        *_, after = env.step(np.zeros(3, np.float32))
    np.testing.assert_array_equal(after["inertia_true"], info["inertia_true"])
    env.reset(options={"inertia": FUEL.replace(values=(1.0, 1.1, 1.0, 1.0))})
    with pytest.raises(ValueError, match="no room for the table's knots: make it with a table of as many"):
        env.reset(options={"inertia": InertiaLaw("table", times=range(20), values=np.ones(20))})
    with pytest.raises(ValueError, match="no room for the fuel's knots"):
        SatInertiaIDEnv().reset(seed=0, options={"inertia": FUEL})


def test_a_table_is_never_drawn():
    assert "table" not in INERTIA_MODES
    with pytest.raises(ValueError, match="unknown inertia mode 'table'"):
        SatInertiaIDEnv(inertia="table")


def test_without_a_table_no_room_is_kept_for_one():
    env = SatInertiaIDVectorEnv(1)
    assert env.state()["plants"]["knot_time"].shape == (1, 1)
    assert SatInertiaIDVectorEnv(1, inertia=FUEL).state()["plants"]["knot_time"].shape == (1, 8)


def test_a_law_goes_to_plain_values_and_back():
    for law in (FUEL, BOOM, FUEL.replace(values=[np.eye(3) * k for k in range(4)])):
        again = InertiaLaw.from_dict(law.to_dict())
        assert again == law
        np.testing.assert_array_equal(again.values, law.values)
    assert FUEL.label == "fuel"
    assert BOOM.label == "table"


def test_a_function_is_sampled_within_what_is_said():
    """Off by at most period^2 / 8 max|f''|, exact at the samples."""

    def ringing(t):
        return 1.0 + 0.03 * np.sin(2.0 * np.pi * 0.02 * t)

    t = np.linspace(0.0, 300.0, 3001)
    for period in (1.0, 0.25):
        law = InertiaLaw.sampled(ringing, horizon=300.0, period=period, name="ringing")
        error = np.abs(law_inertia(law, np.ones(3), t)[:, 0, 0] - ringing(t)).max()
        said = period**2 / 8.0 * 0.03 * (2.0 * np.pi * 0.02) ** 2
        assert 0.9 * said < error <= said * (1.0 + 1e-9)
    boom = InertiaLaw.sampled(lambda t: (0.01 * t, 0.0, 0.01 * t), horizon=10.0)
    np.testing.assert_allclose(law_inertia(boom, np.ones(3), [2.5])[0], np.diag([1.025, 1.0, 1.025]), rtol=1e-12)


def test_a_table_with_products_of_inertia_is_filtered_with_all_six_parameters():
    tilting = InertiaLaw("table", times=(0.0, 9.0), values=[np.zeros((3, 3)), [[0, 0.5, 0], [0.5, 0, 0], [0, 0, 0]]])
    assert SatInertiaIDEnv(inertia=tilting).problem.parameters == "full"
    assert SatInertiaIDEnv(inertia=BOOM).problem.parameters == "principal"


def test_a_table_that_no_body_can_follow_is_refused(pyramid):
    cut = InertiaLaw("table", times=(0.0, 10.0), values=[(0.0, 0.0, 0.0), (-6.0, 0.0, 0.0)], name="cut")
    with pytest.raises(ValueError, match="inertia of pyramid at 10 s of its cut"):
        SatInertiaIDEnv(pyramid, inertia=cut)


def test_drawn_inertias_are_physical_all_along_the_table():
    """A change that only some of the drawn inertias can bear: those that cannot are drawn again."""
    law = InertiaLaw("table", times=(0.0, 10.0), values=[(0.0, 0.0, 0.0), (2.5, 0.0, 0.0)])
    env = SatInertiaIDVectorEnv(64, inertia=law, scenario={"inertia_std": 0.3})
    env.reset(seed=0)
    for _ in range(10):
        *_, infos = env.step(np.zeros((64, 3), np.float32))
    moments = np.linalg.eigvalsh(infos["inertia_true"])
    assert (moments[:, 0] + moments[:, 1] >= moments[:, 2] * (1.0 - 1e-8)).all()


@cases(
    ("changes", "message"),
    [
        ({"values": None}, "needs times .K,. and values"),
        ({"times": (0.0, 2.0, 1.0)}, r"increasing numbers of seconds, got shape \(3,\) with 1 after 2"),
        ({"times": (0.0, 1.0, 1.0)}, "with 1 after 1"),
        ({"times": 3.0}, "increasing numbers of seconds"),
        ({"times": np.arange(KNOTS_MAX + 1.0)}, f"1 to {KNOTS_MAX} increasing"),
        ({"times": (0.0, 1.0, np.nan)}, "times of the inertia law must be finite"),
        ({"values": (1.0, 0.0, 1.0)}, "factors of the inertia law must be positive, got 0 at 1 s"),
        ({"values": (1.0, 1.1)}, r"values of the inertia law must have shape \(3,\) or \(3, 3\) or \(3, 3, 3\)"),
        ({"values": np.arange(27.0).reshape(3, 3, 3)}, "must be symmetric"),
        ({"size": 0.1}, "leave out `size` and `change`"),
        ({"change": (1.0, 1.0, 1.0)}, "leave out `size` and `change`"),
        ({"mode": "drift"}, 'times and values are those of a law with mode "table"'),
    ],
)
def test_what_is_no_table_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        InertiaLaw(**({"mode": "table", "times": (0.0, 1.0, 2.0), "values": (1.0, 1.1, 1.2)} | changes))


@cases(("horizon", "period"), [(10.0, 3.0), (1e6, 1.0), (1.0, 2.0)])
def test_a_period_that_does_not_fill_the_horizon_is_refused(horizon, period):
    with pytest.raises(ValueError, match="must be an integer below"):
        InertiaLaw.sampled(lambda _: 1.0, horizon=horizon, period=period)
