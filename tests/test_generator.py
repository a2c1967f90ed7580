"""Draw of episodes: the distribution of every quantity, limits of the bodies, and refusals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from satid_gym import InertiaLaw, LawRanges, SatInertiaIDEnv, SatInertiaIDVectorEnv
from satid_gym.laws import INERTIA_MODES
from satid_gym.rigid_body import inertia_tensor
from tests.cases import case, cases

COUNT = 1000
STD = 5.0 / np.sqrt(COUNT)  # five standard deviations of a mean of unit variance
RANGES = LawRanges(
    step_size=(0.05, 0.15),
    step_time=(0.3, 0.7),
    drift_size=(-0.1, 0.3),
    periodic_size=(0.01, 0.05),
    frequency=(0.01, 0.03),
    phase=(0.5, 2.0),
)
WORLD = {
    "laws": RANGES,
    "inertia_std": 0.05,
    "tilt_std": 0.0,
    "wheel_speed_range": 0.4,
    "initial_rate_std": 0.1,
    "horizon": 200.0,
}


def draw(satellite, inertia, scenario, count: int = COUNT, seed: int = 0) -> np.ndarray:
    """Records of the truth of episodes at their start."""
    envs = SatInertiaIDVectorEnv(count, satellite, inertia, scenario)
    envs.reset(seed=seed)
    return envs.state()["plants"]


def follows(values: np.ndarray, distribution) -> None:
    """Whether values are of a distribution, by a Kolmogorov-Smirnov test that errs once in a hundred thousand."""
    assert stats.kstest(np.ravel(values), distribution.cdf).pvalue > 1e-5


def uniform(low: float, high: float):
    return stats.uniform(low, high - low)


def is_physical(tensor: np.ndarray) -> bool:
    try:
        inertia_tensor(tensor)
    except ValueError:
        return False
    return True


@pytest.fixture(scope="module")
def body(pyramid):
    return pyramid.replace(disturbance_std=3e-4, rate_limit=0.03)


@pytest.fixture(scope="module")
def plants(body) -> np.ndarray:
    return draw(body, "random", WORLD)


def test_laws_are_drawn_from_their_ranges(plants):
    np.testing.assert_allclose(np.bincount(plants["law"], minlength=4) / COUNT, 0.25, atol=0.5 * STD)
    follows(plants["law_frequency"], uniform(*RANGES.frequency))
    follows(plants["law_phase"], uniform(*RANGES.phase))
    size = plants["change"][:, 0, 0] / plants["inertia"][:, 0, 0]
    sizes = {"step": RANGES.step_size, "drift": RANGES.drift_size, "periodic": RANGES.periodic_size}
    for number, mode in enumerate(INERTIA_MODES):
        chosen = plants["law"] == number
        with case(mode):
            if mode in sizes:
                follows(size[chosen], uniform(*sizes[mode]))
            else:
                np.testing.assert_array_equal(size[chosen], 0.0)
            if mode == "step":
                follows(plants["law_time"][chosen], uniform(60.0, 140.0))
            else:
                np.testing.assert_allclose(plants["law_time"][chosen], 200.0, rtol=1e-12)
    np.testing.assert_allclose(plants["change"], size[:, None, None] * plants["inertia"], rtol=1e-10, atol=1e-12)
    np.testing.assert_array_equal(plants["stepped"], 0)


@cases("mode", INERTIA_MODES)
def test_a_law_that_is_asked_for_is_drawn_alone(mode, body):
    plants = draw(body, mode, WORLD, count=20)
    np.testing.assert_array_equal(plants["law"], INERTIA_MODES.index(mode))


def test_axes_of_the_inertia_scatter_by_themselves(plants, body):
    """J = S J0 S with S diagonal: each moment lognormal, each product the geometric mean's share of its own."""
    ratio = plants["inertia"] / body.inertia
    log = np.log(np.diagonal(ratio, axis1=1, axis2=2))
    follows(log / 0.05, stats.norm)
    scale = np.sqrt(np.diagonal(ratio, axis1=1, axis2=2))
    np.testing.assert_allclose(ratio, scale[:, :, None] * scale[:, None, :], rtol=1e-10)
    off = np.corrcoef(log.T) - np.eye(3)
    assert np.abs(off).max() < STD


def test_a_tilt_turns_the_body_by_small_angles_about_every_axis(microsat):
    """To first order a product of inertia is the angle times the difference of the moments."""
    plants = draw(microsat, "static", WORLD | {"inertia_std": 0.0, "tilt_std": 1e-3})
    inertia, moments = plants["inertia"], np.diag(microsat.inertia)
    np.testing.assert_allclose(np.linalg.eigvalsh(inertia), np.tile(np.sort(moments), (COUNT, 1)), rtol=1e-10)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        with case((i, j)):
            follows(inertia[:, i, j] / (moments[i] - moments[j]) / 1e-3, stats.norm)
    assert np.abs(np.corrcoef([inertia[:, 0, 1], inertia[:, 0, 2], inertia[:, 1, 2]]) - np.eye(3)).max() < STD


def test_a_large_tilt_keeps_the_principal_moments(body):
    plants = draw(body, "static", WORLD | {"inertia_std": 0.0, "tilt_std": 0.3}, count=50)
    np.testing.assert_allclose(
        np.linalg.eigvalsh(plants["inertia"]), np.tile(np.linalg.eigvalsh(body.inertia), (50, 1)), rtol=1e-10
    )
    assert np.abs(plants["inertia"] - body.inertia).max() > 0.1


def test_disturbance_rates_speeds_and_attitude_follow_their_distributions(plants, body):
    """Half the disturbance's variance is constant, half periodic with the orbit."""
    for name in ("torque_constant", "torque_cosine", "torque_sine"):
        with case(name):
            follows(plants[name] / (3e-4 * np.sqrt(0.5)), stats.norm)
    follows(plants["rate"] / (0.1 * 0.03), stats.norm)
    for k, limit in enumerate(body.wheels.max_speed):
        with case(f"wheel {k}"):
            follows(plants["wheel_speed"][:, k], uniform(-0.4 * limit, 0.4 * limit))
    attitude = plants["attitude"]
    np.testing.assert_allclose(np.linalg.norm(attitude, axis=1), 1.0, rtol=1e-12)
    for part in attitude.T:  # of a point anywhere on the unit sphere in four dimensions
        follows(part**2, stats.beta(0.5, 1.5))
        assert abs(np.mean(np.sign(part))) < STD


def test_what_is_drawn_is_independent(plants):
    drawn = [plants["law_frequency"], plants["law_phase"]]
    for name in ("torque_constant", "torque_cosine", "torque_sine", "rate", "wheel_speed", "attitude"):
        drawn += list(plants[name].T)
    drawn.append(plants["inertia"][:, 0, 0])
    assert np.abs(np.corrcoef(drawn) - np.eye(len(drawn))).max() < STD


def test_momentum_is_that_of_the_body_and_the_wheels_at_the_start(plants, body):
    factor = np.where(plants["law"] == INERTIA_MODES.index("periodic"), np.sin(plants["law_phase"]), 0.0)
    inertia = plants["inertia"] + factor[:, None, None] * plants["change"]
    spin = body.wheels.inertia * plants["wheel_speed"]
    momentum = np.einsum("nij,nj->ni", inertia, plants["rate"]) + spin @ body.wheels.axes.T
    np.testing.assert_allclose(plants["momentum"], momentum, rtol=1e-9, atol=1e-12)


def test_an_absolute_change_is_not_scaled(microsat):
    """A deployment given in kg m^2 is the same for every body drawn, and no body is drawn that it breaks."""
    change = np.array([[0.5, 0.1, 0.0], [0.1, 0.4, -0.2], [0.0, -0.2, 0.3]])
    env = SatInertiaIDEnv(microsat, InertiaLaw("step", time=33.3, change=change), WORLD | {"inertia_std": 0.15})
    for seed in range(5):
        env.reset(seed=seed)
        plant = env.fleet.rows.plants[0]
        np.testing.assert_array_equal(plant["change"], change)
        assert is_physical(plant["inertia"] + change)


@cases(
    ("mode", "moments", "change"),
    [
        # the triangle inequality leaves little: J_z <= J_x + J_y, 12.49 kg m^2 for the nominal body
        ("step", (6.53, 5.96, 4.53), (0.0, 0.0, 7.5)),
        ("drift", (6.53, 5.96, 4.53), (0.0, 0.0, 7.5)),
        ("periodic", (6.53, 5.96, 11.0), (0.0, 0.0, 1.2)),
        ("periodic", (6.53, 5.96, 11.0), (0.0, 0.0, -1.2)),
    ],
)
def test_bodies_that_the_law_would_break_are_drawn_again(mode, moments, change, microsat):
    """What is flown is the lognormal scatter less the bodies that are not physical all along the law."""
    law = InertiaLaw(mode, time=60.0, frequency=0.01, change=change)
    plants = draw(microsat.replace(inertia=moments), law, {"inertia_std": 0.3}, count=400)
    ends = (-1.0, 0.0, 1.0) if mode == "periodic" else (0.0, 1.0)
    for inertia in plants["inertia"]:
        assert all(is_physical(inertia + f * law.change) for f in ends)
    tried = np.array(moments) * np.exp(0.3 * np.random.default_rng(0).standard_normal((20_000, 3)))
    ended = tried[:, None, :] + np.multiply.outer(ends, change)
    kept = tried[((ended > 0.0) & (2.0 * ended <= ended.sum(axis=2, keepdims=True))).all(axis=(1, 2))]
    assert len(kept) < 0.9 * len(tried)
    for axis in range(3):
        flown = plants["inertia"][:, axis, axis]
        assert stats.ks_2samp(flown, kept[:, axis]).pvalue > 1e-5, axis


def test_where_no_body_is_physical_the_draw_ends_with_an_error(microsat):
    """Moments that scatter over ten thousands of decades hardly ever meet the triangle inequality."""
    env = SatInertiaIDEnv(microsat, "static", {"inertia_std": 1e5})
    with pytest.raises(ValueError, match="no physical inertia tensor in 1000 draws"):
        env.reset(seed=0)


def test_a_step_at_time_zero_has_come(microsat):
    env = SatInertiaIDEnv(microsat, InertiaLaw("step", size=0.1, time=0.0), {"inertia_std": 0.0})
    _, info = env.reset(seed=0)
    np.testing.assert_allclose(info["inertia_true"], 1.1 * microsat.inertia)


def test_wheels_start_within_their_limit():
    env = SatInertiaIDEnv("cubesat", scenario={"wheel_speed_range": 1.0})
    speeds = []
    for seed in range(20):
        env.reset(seed=seed)
        speeds.append(env.fleet.rows.plants["wheel_speed"][0] / 460.0)
    assert np.abs(speeds).max() <= 1.0 + 1e-12
    assert np.max(speeds) > 0.8
    assert np.min(speeds) < -0.8


def test_a_world_at_rest_is_drawn_at_rest(microsat):
    """No spread, no random attitude: the nominal satellite, as the template has it."""
    calm = {"inertia_std": 0.0, "wheel_speed_range": 0.0, "initial_rate_std": 0.0, "disturbance_scale": 0.0}
    env = SatInertiaIDEnv(microsat, "static", calm | {"random_attitude": False})
    env.reset(seed=0)
    plant = env.fleet.rows.plants[0]
    np.testing.assert_array_equal(plant["attitude"], [0.0, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(plant["inertia"], microsat.inertia, rtol=1e-14)
    for name in ("rate", "wheel_speed", "momentum", "torque_constant", "torque_cosine", "torque_sine"):
        np.testing.assert_array_equal(plant[name], 0.0)


FAULTS = {
    "time": (0.2, 0.6),
    "gyro_dropout": 0.5,
    "gyro_dropout_silent": 0.3,
    "gyro_dropout_duration": (5.0, 20.0),
    "tachometer_stuck": 0.6,
    "tachometer_stuck_duration": (20.0, 60.0),
    "wheel_loss": 0.4,
    "wheel_loss_size": (0.3, 0.9),
}


def faulty(pyramid, **more) -> np.ndarray:
    scenario = {"inertia_std": 0.0, "horizon": 200.0, "gyro_bias_walk": 0.0, "faults": FAULTS | more}
    return draw(pyramid, "static", scenario)


def test_faults_are_drawn_from_their_distributions(pyramid):
    plants = faulty(pyramid, torque_delay=(1, 3), gyro_bias_std=2e-5)
    start = uniform(40.0, 120.0)
    assert (plants["faulty"] == 1).all()

    dropout, silent = plants["gyro_dropout"], plants["gyro_dropout_silent"] == 1
    happened = dropout[:, 1] > 0.0
    assert happened.mean() == pytest.approx(0.5, abs=0.5 * STD)
    assert silent[happened].mean() == pytest.approx(0.3, abs=0.5 * STD * np.sqrt(2.0))
    follows(dropout[happened, 0], start)
    follows(dropout[happened, 1] - dropout[happened, 0], uniform(5.0, 20.0))
    np.testing.assert_array_equal(dropout[~happened], 0.0)
    assert not silent[~happened].any()

    stuck, wheel = plants["tachometer_stuck"], plants["tachometer_stuck_wheel"]
    happened = wheel >= 0
    assert happened.mean() == pytest.approx(0.6, abs=0.5 * STD)
    np.testing.assert_allclose(np.bincount(wheel[happened], minlength=4) / happened.sum(), 0.25, atol=0.7 * STD)
    follows(stuck[happened, 0], start)
    follows(stuck[happened, 1] - stuck[happened, 0], uniform(20.0, 60.0))
    np.testing.assert_array_equal(stuck[~happened], 0.0)

    weak = plants["wheel_loss_wheel"]
    happened = weak >= 0
    assert happened.mean() == pytest.approx(0.4, abs=0.5 * STD)
    np.testing.assert_allclose(np.bincount(weak[happened], minlength=4) / happened.sum(), 0.25, atol=0.8 * STD)
    follows(plants["wheel_loss_start"][happened], start)
    follows(plants["wheel_loss_left"][happened], uniform(0.1, 0.7))

    np.testing.assert_allclose(
        np.bincount(plants["torque_delay"], minlength=4) / COUNT, [0, *[1 / 3] * 3], atol=0.5 * STD
    )
    follows(plants["gyro_bias"] / 2e-5, stats.norm)
    noise = plants["gyro"] - plants["rate"] - plants["gyro_bias"]
    follows(noise / pyramid.gyro_noise_std, stats.norm)


def test_what_cannot_happen_is_not_drawn(pyramid):
    """And draws nothing: all that comes after it in the stream is what it would be without."""
    plain, more = faulty(pyramid, gyro_dropout=0.0), faulty(pyramid, gyro_dropout=0.0, gyro_dropout_silent=0.0)
    np.testing.assert_array_equal(plain["gyro_dropout"], 0.0)
    np.testing.assert_array_equal(plain["gyro_dropout_silent"], 0)
    np.testing.assert_array_equal(plain["stream"], more["stream"])
    np.testing.assert_array_equal(plain["torque_delay"], 0)
    np.testing.assert_array_equal(plain["gyro_bias"], 0.0)
    late = faulty(pyramid, torque_delay=(0, 1))
    assert set(late["torque_delay"]) == {0, 1}
    assert (late["torque_delay"] == 1).mean() == pytest.approx(0.5, abs=0.5 * STD)
