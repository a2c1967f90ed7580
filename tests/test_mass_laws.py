"""Laws of a mass that moves or leaves: the tensor and its motion against point masses, the draw, and the filter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import solve_ivp

from satid_gym import InertiaLaw, LawRanges, SatInertiaIDEnv, SatInertiaIDVectorEnv, simulate
from satid_gym.core import kernels
from satid_gym.estimators import AdaptiveEKF
from satid_gym.evaluation import fly, seeds
from satid_gym.laws import MASS_MODES
from satid_gym.plants import law_inertia
from satid_gym.policies.registry import make_baseline
from satid_gym.rigid_body import inertia_tensor, least_second_moment
from satid_gym.scenario import Scenario, prior_of
from tests.cases import cases

PLACE = np.array([0.4, -0.3, 0.6])
BOOM = InertiaLaw("deployment", mass=2.0, place=PLACE, time=3.0, duration=12.0)
FUEL = InertiaLaw("fuel", mass=0.9, place=PLACE, time=15.0)
PAYLOAD = InertiaLaw("release", mass=1.1, place=PLACE, time=7.77)


def inertia_of_points(masses: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Tensor of point masses (N,) at (N, 3) about their centre of mass."""
    r = places - np.average(places, axis=0, weights=masses)
    return np.einsum("i,ij,ij->", masses, r, r) * np.eye(3) - np.einsum("i,ij,ik->jk", masses, r, r)


@cases("law", [BOOM, FUEL, PAYLOAD])
def test_a_mass_adds_its_reduced_mass_about_the_centre_that_moves(law):
    """A body of nine points and one more, each about the centre of all that is there."""
    generator = np.random.default_rng(3)
    masses, places = generator.uniform(5.0, 15.0, 9), generator.uniform(-0.5, 0.5, (9, 3))
    rest, whole = inertia_of_points(masses, places), masses.sum()
    moved = law.mass * whole / (whole - law.mass)  # so that its reduced mass is the law's
    at = np.average(places, axis=0, weights=masses) + law.place
    there = inertia_of_points(np.append(masses, moved), np.vstack([places, at]))
    first, last = law_inertia(law, rest if law.mode == "deployment" else there, [0.0, 1e3])
    before, after = (rest, there) if law.mode == "deployment" else (there, rest)
    np.testing.assert_allclose(first, before, rtol=1e-12)
    np.testing.assert_allclose(last, after, rtol=1e-12, atol=1e-12)


def test_what_a_law_does_between_its_ends():
    change = 2.0 * (PLACE @ PLACE * np.eye(3) - np.outer(PLACE, PLACE))
    grown = law_inertia(BOOM, (6.0, 5.0, 4.0), [3.0, 6.0, 9.0, 15.0]) - np.diag([6.0, 5.0, 4.0])
    for own, share in zip(grown, (0.0, 5.0 / 32.0, 0.5, 1.0), strict=True):  # s^2 (3 - 2 s) at s = 1/4: 10/64
        np.testing.assert_allclose(own, share * change, atol=1e-12)
    shares = law_inertia(FUEL, (6.0, 5.0, 4.0), [0.0, 3.0, 15.0, 20.0])[:, 0, 1] / (0.45 * -change[0, 1])
    np.testing.assert_allclose(shares, [0.0, 0.2, 1.0, 1.0], atol=1e-12)
    late = law_inertia(PAYLOAD, (6.0, 5.0, 4.0), [7.76, 7.77])[:, 0, 0]
    np.testing.assert_allclose(late, [6.0, 6.0 - 0.55 * change[0, 0]])


def euler(tensor, until, rate, momentum=None):
    """Rate after d(J omega)/dt = -omega x J omega, J a function of time."""
    start = tensor(0.0) @ rate if momentum is None else momentum

    def slope(t, m):
        return -np.cross(np.linalg.solve(tensor(t), m), m)

    steps = {"rtol": 1e-12, "atol": 1e-14, "max_step": 0.5}
    return np.linalg.solve(tensor(until), solve_ivp(slope, (0.0, until), start, **steps).y[:, -1])


@cases("law", [BOOM, FUEL])
def test_a_body_whose_mass_moves_inside_turns_as_eulers_equation_says(law, microsat):
    """Points that go out along a line, or flow to the centre: no momentum of their own, and none goes lost."""
    rate = np.array([0.3, -0.2, 0.4])
    flight = simulate(microsat, np.zeros((200, 3)), 0.1, omega0=rate, law=law, wheel_speed0=-rate)
    rotors = microsat.wheels.rotor_inertia  # at rest in space

    def tensor(t):
        s = np.clip((t - 3.0) / 12.0, 0.0, 1.0)
        out = np.sqrt(s * s * (3.0 - 2.0 * s)) * PLACE if law is BOOM else PLACE
        mass = 2.0 if law is BOOM else 0.9 * (1.0 - min(t / 15.0, 1.0))
        full = (
            microsat.inertia
            - rotors
            - (0.0 if law is BOOM else 0.9) * (PLACE @ PLACE * np.eye(3) - np.outer(PLACE, PLACE))
        )
        return full + mass * (out @ out * np.eye(3) - np.outer(out, out))

    np.testing.assert_allclose(flight.omega[-1], euler(tensor, 20.0, rate), rtol=0.0, atol=1e-9)
    assert np.linalg.norm(flight.omega[-1] - euler(lambda _: tensor(0.0), 20.0, rate)) > 0.01


def test_what_is_released_turns_on_as_it_did(microsat):
    """The rate stays in the moment, and the rest flies on as the body that it now is."""
    torque = np.random.default_rng(0).uniform(-0.1, 0.1, (150, 3))
    start = {"omega0": (0.02, -0.03, 0.01), "wheel_speed0": (100.0, -80.0, 50.0)}
    law = PAYLOAD.replace(time=7.5 - 1e-9)
    whole = simulate(microsat, torque, 0.1, **start, law=law)
    alone = simulate(
        microsat.replace(inertia=microsat.inertia + law.mass_change),
        torque[75:],
        0.1,
        omega0=whole.omega[75],
        wheel_speed0=whole.wheel_speed[75],
        attitude0=whole.attitude[75],
    )
    np.testing.assert_allclose(whole.omega[75:], alone.omega, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(whole.momentum[75:], alone.momentum, rtol=0.0, atol=1e-12)
    kept = simulate(microsat, torque, 0.1, **start)
    np.testing.assert_allclose(whole.omega[75], kept.omega[75], rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(whole.momentum[75] - kept.momentum[75], law.mass_change @ kept.omega[75], atol=1e-10)


# The draw

RANGES = LawRanges(deployment_size=(0.1, 0.5), fuel_size=(0.02, 0.2), release_size=(0.05, 0.25))
COUNT = 600


def drawn(satellite, mode, **scenario) -> np.ndarray:
    envs = SatInertiaIDVectorEnv(COUNT, satellite, mode, {"laws": RANGES, **scenario})
    envs.reset(seed=0)
    return envs.state()["plants"]


@cases("mode", MASS_MODES)
def test_place_and_mass_are_drawn(mode, microsat):
    plants = drawn(microsat, mode, inertia_std=0.02)
    sign = 1.0 if mode == "deployment" else -1.0
    moments, ways = np.linalg.eigh(sign * plants["change"])
    np.testing.assert_allclose(moments[:, 0], 0.0, atol=1e-12)
    np.testing.assert_allclose(moments[:, 1], moments[:, 2], rtol=1e-9)
    size = moments[:, 2] * 3.0 / np.trace(plants["inertia"], axis1=1, axis2=2)
    low, high = getattr(RANGES, f"{mode}_size")
    assert stats.kstest(size, stats.uniform(low, high - low).cdf).pvalue > 1e-5
    for axis in range(3):  # of a point anywhere on a sphere
        assert stats.kstest(np.abs(ways[:, axis, 0]), stats.uniform(0.0, 1.0).cdf).pvalue > 1e-5
    times = {"deployment": (60.0, 180.0), "fuel": (300.0, 300.0), "release": (90.0, 210.0)}[mode]
    assert times[0] <= plants["law_time"].min() <= plants["law_time"].max() <= times[1]
    if mode == "deployment":
        assert stats.kstest(plants["law_duration"], stats.uniform(5.0, 55.0).cdf).pvalue > 1e-5
    if mode != "fuel":
        assert np.ptp(plants["law_time"]) > 0.9 * (times[1] - times[0])


@cases("mode", MASS_MODES)
def test_a_body_that_could_not_hold_the_mass_is_drawn_again(mode, microsat):
    """Nearly a plate, of which little may leave across; and where nothing may, the draw ends with an error."""
    plate = microsat.replace(inertia=(2.0, 2.1, 4.0))
    for plant in drawn(plate, mode, inertia_std=0.05):
        for share in (0.0, 0.5, 1.0):
            inertia_tensor(plant["inertia"] + share * plant["change"])
    if mode != "deployment":
        flat = SatInertiaIDEnv(microsat.replace(inertia=(2.0, 2.0, 4.0)), mode, {"inertia_std": 0.0})
        with pytest.raises(ValueError, match="no physical inertia tensor in 1000 draws"):
            flat.reset(seed=0)


def test_the_draw_of_a_mass_takes_nothing_from_the_other_draws(microsat):
    envs = {mode: SatInertiaIDEnv(microsat, mode, {"inertia_std": 0.0}) for mode in ("static", *MASS_MODES)}
    rates = []
    for env in envs.values():
        env.reset(seed=5)
        rates.append(env.fleet.rows.plants[0]["inertia"].copy())
    np.testing.assert_array_equal(rates, np.tile(microsat.inertia, (4, 1, 1)))


@cases("mode", MASS_MODES)
def test_a_mass_needs_all_six_parameters(mode):
    assert SatInertiaIDEnv(inertia=mode).problem.parameters == "full"
    with pytest.raises(ValueError, match=f"a {mode} moves a mass to or from a place that is drawn"):
        SatInertiaIDEnv(inertia=mode, estimator={"name": "adaptive", "parameters": "principal"})
    law = {"deployment": BOOM, "fuel": FUEL, "release": PAYLOAD}[mode]
    assert SatInertiaIDEnv(inertia=law).problem.parameters == "full"
    assert InertiaLaw.from_dict(law.to_dict()) == law


@cases(
    ("settings", "message"),
    [
        ({"mode": "release"}, 'needs mass, kg, and place .3,., m; inertia="release" draws both'),
        ({"mode": "fuel", "mass": 1.0}, "needs mass, kg, and place"),
        ({"mode": "step", "mass": 1.0}, "mass and place are those of a law with mode deployment, fuel, release, this"),
        ({"mode": "fuel", "mass": 0.0, "place": PLACE}, "mass of the inertia law must be finite and more than 0"),
        ({"mode": "fuel", "mass": 1.0, "place": (0, 0, 0)}, "must not be the centre of mass"),
        ({"mode": "fuel", "mass": 1.0, "place": (0, 1)}, r"place of the inertia law must have shape \(3,\)"),
        ({"mode": "fuel", "mass": 1.0, "place": PLACE, "size": 0.1}, "leave out `size` and `change`"),
        ({"mode": "deployment", "mass": 1.0, "place": PLACE, "duration": 0.0}, "duration of the inertia law"),
    ],
)
def test_what_is_no_mass_is_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        InertiaLaw(**settings)


def test_a_payload_that_no_body_can_lose_is_refused(microsat):
    assert least_second_moment(microsat.inertia + PAYLOAD.replace(mass=40.0).mass_change) < 0.0
    with pytest.raises(ValueError, match="inertia of microsat at the end of its release"):
        simulate(microsat, np.zeros((1, 3)), 1.0, law=PAYLOAD.replace(mass=40.0))


# What the filter does


@cases("leaves", [0, 1])
def test_an_announced_change_adds_what_its_equation_says(leaves, skewed):
    ekf = AdaptiveEKF()
    rate, speed = np.array([0.02, -0.01, 0.03]), np.array([50.0, -20.0, 10.0])
    ekf.reset(prior_of(skewed, Scenario()), rate, speed)
    told, untold = ekf.records.copy(), ekf.records.copy()
    told["announced"], told["leaves"] = 0.25, leaves
    for rows in (told, untold):
        kernels.predict_filter(rows, ekf.work, speed, 0.1)
    added = told["covariance"][0, :9, :9] - untold["covariance"][0, :9, :9]
    mean, s = untold["mean"][0], 0.25 * np.diag((0.2 * untold["theta_scale"][0]) ** 2)
    t = mean[3:9]
    tensor = np.array([[t[0], t[3], t[4]], [t[3], t[1], t[5]], [t[4], t[5], t[2]]])
    w = np.linalg.solve(tensor, mean[:3] - skewed.wheels.axes @ (skewed.wheels.inertia * speed))
    regressor = np.array([[w[0], 0, 0, w[1], w[2], 0], [0, w[1], 0, w[0], 0, w[2]], [0, 0, w[2], 0, w[0], w[1]]])
    regressor = leaves * regressor
    expected = np.block([[regressor @ s @ regressor.T, regressor @ s], [s @ regressor.T, s]])
    np.testing.assert_allclose(added, expected, rtol=1e-9, atol=1e-15)


def nees(mode: str, announced: bool) -> float:
    policy = make_baseline("rate_square", "microsat")
    estimator = {"name": "adaptive", "announced": announced}
    flight = fly(policy, satellite="microsat", inertia=mode, seeds=seeds("validation", 20), estimator=estimator)
    return float(flight.scores()["nees"].mean())


@pytest.mark.parametrize("mode", MASS_MODES)
@pytest.mark.compiled
def test_a_filter_that_is_told_when_is_consistent(mode):
    assert 0.3 < nees(mode, announced=True) < 2.0
    assert (nees(mode, announced=False) > 3.0) == (mode != "fuel")
