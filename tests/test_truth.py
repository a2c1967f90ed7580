"""Truth from elsewhere: the same episodes on an integrator of the test's own, and answers that are refused."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from scipy.integrate import solve_ivp

from satid_gym import SatInertiaIDEnv, SatInertiaIDVectorEnv
from satid_gym.core import kernels
from satid_gym.estimators import AdaptiveEKF
from satid_gym.evaluation import fly
from satid_gym.fleet import Fleet
from satid_gym.laws import INERTIA_MODES, MASS_MODES, InertiaLaw
from satid_gym.plants import law_inertia, new_plant
from satid_gym.policies import build
from satid_gym.problem import problem
from satid_gym.truth import State
from satid_gym.truth.drawn import drawn_episode
from satid_gym.truth.kernels import draw
from tests.cases import cases

SEED = 11


class Euler:
    """Euler's equations of a rigid body with wheels and of its quaternion, by SciPy; inertia static or drifting."""

    follows_law = True

    def start(self, episode):
        self.episode, self.time = episode, 0.0
        self.y = np.concatenate([episode.rate, episode.wheel_speed, episode.attitude])
        return self.state()

    def advance(self, torque, disturbance, duration):
        span = (self.time, self.time + duration)
        path = solve_ivp(self.slopes, span, self.y, "DOP853", rtol=1e-12, atol=1e-13, args=(torque, disturbance))
        self.y, self.time = path.y[:, -1], span[1]
        return self.state()

    def inertia(self, t):
        """J and dJ/dt, of a drift until its full size or of a static inertia."""
        law, inertia = self.episode.law, self.episode.satellite.inertia
        if law.mode == "static":
            return inertia, np.zeros((3, 3))
        (change,) = law.changes
        return inertia + t / law.time * change, change / law.time

    def slopes(self, t, y, torque, disturbance):
        wheels, (J, slope) = self.episode.satellite.wheels, self.inertia(t)
        omega, speed, q = y[:3], y[3:-4], y[-4:]
        momentum = J @ omega + wheels.axes @ (wheels.inertia * speed)
        push = disturbance - np.cross(omega, momentum) - slope @ omega - wheels.axes @ torque
        acceleration = np.linalg.solve(J - wheels.rotor_inertia, push)
        spin_up = torque / wheels.inertia - wheels.axes.T @ acceleration
        turn = 0.5 * np.append(q[3] * omega + np.cross(q[:3], omega), -q[:3] @ omega)
        return np.concatenate([acceleration, spin_up, turn])

    def state(self):
        attitude = self.y[-4:] / np.linalg.norm(self.y[-4:])
        return State(rate=self.y[:3], wheel_speed=self.y[3:-4], attitude=attitude, inertia=self.inertia(self.time)[0])


class Answers(Euler):
    """The same with something else in its answers from the third one on."""

    def __init__(self, **changes):
        self.changes = changes

    def start(self, episode):
        self.asked = 0
        return super().start(episode)

    def state(self):
        self.asked += 1
        known = super().state()
        fields = {name: getattr(known, name) for name in ("rate", "wheel_speed", "inertia", "attitude")}
        return State(**{**fields, **(self.changes if self.asked > 2 else {})})


def actions(count, size=3):
    waves = (np.arange(count)[:, None] // 6 + np.arange(size)) % 2
    return (0.3 * np.where(waves == 0, 1.0, -1.0)).astype(np.float32)


def flown(count=40, seed=SEED, **settings):
    """Observations and infos of `count` decisions."""
    env = SatInertiaIDEnv("microsat", **settings)
    observation, info = env.reset(seed=seed)
    found = [(observation, 0.0, info)]
    for action in actions(count, *env.action_space.shape):
        observation, reward, terminated, _, info = env.step(action)
        found.append((observation, reward, info))
        assert not terminated
    return found


def assert_same(ours, theirs, within=1e-6):
    for (seen, reward, info), (other, other_reward, other_info) in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(seen, other, rtol=within, atol=within)
        assert reward == pytest.approx(other_reward, rel=within, abs=within)
        assert info["costs"] == other_info["costs"]
        for key, value in info.items():
            if key != "costs":
                np.testing.assert_allclose(
                    np.array(value, float), np.array(other_info[key], float), rtol=within, atol=within, err_msg=key
                )


@cases(
    "settings",
    [
        {"inertia": "static"},
        {"inertia": "drift"},
        {"inertia": "static", "control": "rate", "scenario": {"faults": {"gyro_outlier": 0.05, "wheel_loss": 1.0}}},
        {"inertia": "static", "reward": {"net": True, "gain_scale": 1.0}},
        {"inertia": "static", "estimator": AdaptiveEKF},
    ],
)
def test_an_episode_on_another_integrator_is_that_on_the_environments_own(settings):
    own = settings.get("estimator", lambda: None)
    ours = flown(**{**settings, "estimator": own()})
    theirs = flown(**{**settings, "estimator": own()}, truth=Euler())
    assert ours[-1][2]["relative_error"] < 0.5 * ours[0][2]["relative_error"]
    assert_same(ours, theirs)


def test_a_policy_flies_episodes_side_by_side_each_on_a_truth_of_its_own():
    settings = {"satellite": "microsat", "inertia": "static", "scenario": {"horizon": 20.0}, "seeds": [SEED, SEED + 1]}
    policy = build("multi_step", {"amplitude": 0.05})
    ours, theirs = fly(policy, **settings), fly(policy, **settings, truth=Euler)
    with pytest.raises(ValueError, match="one for each episode"):
        fly(policy, **settings, truth=Euler())
    assert ours.error.shape == (20, 2)
    for series in ("error", "outside", "nees", "information", "effort", "reward", "saturated", "alive"):
        np.testing.assert_allclose(getattr(theirs, series), getattr(ours, series), rtol=1e-5, atol=1e-9, err_msg=series)


def test_attitude_is_integrated_where_the_truth_has_none():
    ours, theirs = (flown(inertia="static", truth=truth) for truth in (Euler(), Answers(attitude=None)))
    assert_same(ours, theirs, within=1e-5)


def test_what_is_unknown_of_the_inertia_is_not_invented():
    world = {"gravity_gradient": False}
    known = flown(4, inertia="static", scenario=world, truth=Euler())
    unknown = flown(4, inertia="static", scenario=world, truth=Answers(inertia=None))
    for (seen, reward, info), (other, other_reward, other_info) in zip(known[1:], unknown[1:], strict=True):
        np.testing.assert_array_equal(seen, other)
        assert reward == other_reward
        assert np.isnan([other_info["relative_error"], other_info["nees"], *other_info["inertia_true"].ravel()]).all()
        np.testing.assert_array_equal(info["inertia_estimate"], other_info["inertia_estimate"])


def test_a_picture_needs_an_inertia():
    for truth, world in ((Euler(), {}), (Answers(inertia=None), {"gravity_gradient": False})):
        env = SatInertiaIDEnv("microsat", "static", world, truth=truth, render_mode="rgb_array")
        env.reset(seed=0)
        assert env.render().shape == (480, 480, 3)
        env.step(np.zeros(3))
    with pytest.raises(ValueError, match="does not tell"):
        env.render()


def test_readings_of_the_truths_own_are_those_that_the_filter_is_given():
    env = SatInertiaIDEnv("microsat", "static", truth=Answers(gyro=[0.01, 0.0, -0.01], tachometer=[1.0, 2.0, 3.0]))
    env.reset(seed=0)
    observation, _, _, _, info = env.step(np.zeros(3))
    satellite = env.problem.satellites[0]
    np.testing.assert_allclose(observation[:3], np.array([0.01, 0.0, -0.01]) / satellite.rate_limit, rtol=1e-6)
    np.testing.assert_allclose(observation[3:6], np.array([1.0, 2.0, 3.0]) / satellite.wheels.max_speed, rtol=1e-6)
    assert info["outside"] == 0.0  # which is of the true rate


def test_wheels_at_their_limit_and_rates_beyond_theirs_are_counted():
    limit = SatInertiaIDEnv("microsat", "static").problem.satellites[0]
    speed, rate = limit.wheels.max_speed * [1.0, 0.5, -1.0], [0.0, -1.1 * limit.rate_limit, 0.0]
    env = SatInertiaIDEnv("microsat", "static", truth=Answers(wheel_speed=speed, rate=rate))
    env.reset(seed=0)
    _, _, _, _, info = env.step(np.zeros(3))
    assert info["saturated"].tolist() == [True, False, True]
    assert info["costs"]["saturation"] == pytest.approx(2.0 / 3.0)
    assert info["outside"] == pytest.approx(0.9)  # of ten states the first is still within


def test_gymnasiums_checker_passes_with_a_truth_by_name():
    env = gymnasium.make("SatInertiaID-v0", inertia="static", truth="tests.test_truth:Euler", disable_env_checker=True)
    check_env(env.unwrapped, skip_render_check=True)


@cases(
    ("changes", "message"),
    [
        ({"rate": [np.nan, 0.0, 0.0]}, "rate of Answers.advance must be finite"),
        ({"wheel_speed": [1.0, 2.0]}, "wheel_speed of Answers.advance must have shape"),
        ({"attitude": [0.0, 0.0, 0.0, 2.0]}, "attitude of Answers.advance must be a quaternion of length 1"),
        ({"inertia": np.diag([1.0, 1.0, 3.0])}, "inertia of Answers.advance"),
        ({"inertia": None}, "gravity gradient"),
        ({"gyro": [0.0, 0.0]}, "gyro of Answers must have shape"),
    ],
)
def test_an_answer_that_is_not_valid_is_refused_in_one_line(changes, message):
    env = SatInertiaIDEnv("microsat", "static", truth=Answers(**changes))
    env.reset(seed=0)
    with pytest.raises(ValueError, match=message) as refusal:
        env.step(np.zeros(3))
    assert "\n" not in str(refusal.value)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(3))
    env.reset(seed=0)


class Still:
    """A truth that follows no law, and reads by itself where it is told to."""

    def __init__(self, **readings):
        self.readings = readings

    def start(self, episode):
        self.known = State(rate=episode.rate, wheel_speed=episode.wheel_speed, **self.readings)
        return self.known

    def advance(self, torque, disturbance, duration):
        return self.known


@cases(
    ("settings", "message"),
    [
        ({"truth": Still()}, "does not follow inertia laws, and inertia is 'random'"),
        ({"truth": Still(), "inertia": InertiaLaw("step", size=0.1)}, "does not follow inertia laws"),
        ({"truth": 3, "inertia": "static"}, "truth must be an object with start"),
        ({"truth": "tests.test_truth", "inertia": "static"}, "expected module:name"),
        ({"truth": "tests.test_truth:Nobody", "inertia": "static"}, "Nobody"),
    ],
)
def test_a_truth_that_cannot_fly_the_problem_is_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        SatInertiaIDEnv(**settings)


@pytest.mark.interpreted
@cases(
    ("settings", "options", "message"),
    [
        ({"truth": Still()}, {"inertia": "step"}, "does not follow inertia laws"),
        ({"truth": Still(gyro=np.zeros(3)), "scenario": {"gravity_gradient": False, "faults": {"wheel_loss": 1.0}}},
         None, "simulates their faults too"),
        ({"truth": Still(), "scenario": {"gravity_gradient": False, "sensors": {"tachometer_delay": 1.0}}},
         None, "between two states"),
    ],
)  # fmt: skip
def test_an_episode_that_a_truth_cannot_fly_is_refused(settings, options, message):
    env = SatInertiaIDEnv("microsat", "static", **settings)
    with pytest.raises(ValueError, match=message):
        env.reset(seed=0, options=options)


def test_the_vector_environment_says_that_it_has_its_own_truth():
    with pytest.raises(ValueError, match="moves one satellite") as refusal:
        SatInertiaIDVectorEnv(2, truth=Euler())
    assert "\n" not in str(refusal.value)


def drawn(*settings, **others):
    """Rows with a drawn episode."""
    fleet = Fleet(problem(*settings, **others), 1)
    fleet.rows.plants["stream"][0] = 1, 2, 3, 4
    assert draw(fleet.rows, fleet.templates.records)
    return fleet


@cases("inertia", [*INERTIA_MODES, *MASS_MODES])
def test_the_law_that_a_truth_is_told_is_the_one_that_was_drawn(inertia):
    fleet = drawn("microsat", inertia)
    plant, times = fleet.rows.plants[0], np.linspace(0.0, 300.0, 61)
    episode = drawn_episode(fleet.problem.satellites[0], plant, 0.1)
    assert episode.law.mode == inertia
    expected = np.empty((len(times), 3, 3))
    kernels.law_inertia(fleet.rows.plants.copy(), times, expected)
    assert inertia == "static" or np.ptp(expected[:, 0, 0]) > 0.0
    told = law_inertia(episode.law, episode.satellite.inertia, times)
    np.testing.assert_allclose(told, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.interpreted
def test_the_satellite_that_a_truth_is_told_has_the_drawn_oscillators_and_wheels():
    tolerances = {"wheel_inertia": 1e-2, "wheel_alignment": 5e-3}
    fleet = drawn("microsat", "static", {"base": "flex", "tolerances": tolerances})
    plant = fleet.rows.plants[0]
    built = drawn_episode(fleet.problem.satellites[int(fleet.rows.tasks["template"][0])], plant, 0.1).satellite
    (told,) = new_plant(built)
    for name in ("inertia", "axes", "wheel_inertia"):
        np.testing.assert_allclose(told[name], plant[name], rtol=1e-12, atol=1e-15)
    for name in ("mass", "rest", "direction", "arm", "inertia", "stiffness", "damping"):
        np.testing.assert_allclose(told["oscillators"][name], plant["oscillators"][name], rtol=1e-12, err_msg=name)
    assert np.abs(plant["oscillators"]["scale"][:, 1] - 1.0).min() > 1e-3
