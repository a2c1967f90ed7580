"""Star tracker: what truth reads, when it is blind, and how the filter estimates the attitude with the inertia."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.studies.recording import record
from satid_gym import (
    SATELLITES,
    SCENARIOS,
    InertiaLaw,
    Pilot,
    Satellite,
    SatInertiaIDEnv,
    SatInertiaIDVectorEnv,
    Scenario,
    Sensors,
    StarTracker,
)
from satid_gym.appendages import panel_pair
from satid_gym.core.observation import observed_std
from satid_gym.estimators import (
    AdaptiveEKF,
    FilterpyAdaptiveEKF,
    FilterpyMomentumEKF,
    FilterpyMomentumUKF,
    MomentumEKF,
    MomentumSmoother,
    RateEKF,
)
from satid_gym.estimators.filterpy.attitude import AttitudeModel
from satid_gym.estimators.momentum import MomentumEKFSettings
from satid_gym.evaluation import fly, seeds
from satid_gym.fleet import Fleet
from satid_gym.policies.registry import make_baseline
from satid_gym.policy import missions
from satid_gym.problem import problem
from satid_gym.scenario import prior_of
from satid_gym.star_tracker import EARTH_GRAVITY, EARTH_RADIUS
from tests.cases import cases

pytestmark = pytest.mark.interpreted

DEGREE = np.pi / 180.0
TRACKER = StarTracker(boresight=[0.6, 0.0, 0.8])
LATE = Sensors(star_tracker=TRACKER, gyro_integrates=True, encoder_pulses=64, tachometer_delay=0.9)
BLINDED = TRACKER.replace(rate_limit=0.02, sun_exclusion=30 * DEGREE, earth_exclusion=10 * DEGREE, reacquire=2.0)
BIAS = {"gyro_bias": 1e-4}  # nearly all tests have one state size, for each has a filter to compile
SCALES = BIAS | {"gyro_scale": 3e-3, "wheel_inertia": 2e-3}  # whose errors last in another way over an update


def world(tracker=TRACKER, **settings):
    return Scenario(**{"tolerances": BIAS, "sensors": Sensors(star_tracker=tracker), "horizon": 60.0, **settings})


def late_world(**settings):
    """World whose readings are averaged, counted and late by a time that is not quite known."""
    return world(tolerances=BIAS | {"tachometer_delay": 0.1}, sensors=LATE, **settings)


def with_panels():
    satellite = SATELLITES["microsat"]
    return satellite.replace(oscillators=(panel_pair(satellite, 0.1, 1, 2, frequency=0.35, damping=0.005),))


@pytest.fixture
def prior():
    return prior_of(SATELLITES["microsat"], world())


# truth


@pytest.mark.compiled
def test_readings_have_the_noise_of_the_data_sheet():
    env = SatInertiaIDVectorEnv(4000, "microsat", "static", world())
    env.reset(seed=0)
    plants = env.fleet.rows.plants
    assert plants["tracker"]["fresh"].all()
    read, true = (Rotation.from_quat(values) for values in (plants["tracker"]["reading"], plants["attitude"]))
    error = (true.inv() * read).as_rotvec()  # in the frame of the body
    along = error @ TRACKER.boresight
    across = error - along[:, None] * TRACKER.boresight
    assert along.std() == pytest.approx(TRACKER.round_std, rel=4.0 / np.sqrt(2.0 * len(along)))
    assert np.sqrt((across**2).sum(axis=1).mean() / 2.0) == pytest.approx(TRACKER.across_std, rel=0.05)
    env.close()


def test_momentum_as_the_star_tracker_sees_it_stays():
    """Noiseless and without torque from outside: R (J omega + A j Omega) is constant while the wheels turn the body."""
    quiet = world(
        TRACKER.replace(across_std=0.0, round_std=0.0),
        disturbance_scale=0.0,
        gravity_gradient=False,
        solar_pressure=0.0,
    )
    env = SatInertiaIDEnv("microsat", "static", quiet)
    env.reset(seed=2)
    seen, turned = [], []
    for i in range(20):
        env.step(np.array([0.2, -0.15, 0.1], np.float32) * (-1.0 if i // 5 % 2 else 1.0))
        plant = env.fleet.rows.plants[0]
        attitude = Rotation.from_quat(plant["tracker"]["reading"])
        spin = plant["axes"] @ (plant["wheel_inertia"] * plant["wheel_speed"])
        seen.append(attitude.apply(plant["inertia"] @ plant["rate"] + spin))
        turned.append(attitude.as_rotvec())
    assert np.abs(np.ptp(seen, axis=0)).max() < 1e-8 * np.linalg.norm(seen[0])
    assert np.ptp(turned, axis=0).max() > 0.05


def test_it_is_blind_as_the_data_sheet_says():
    """Against the rules in plain numpy, on the recorded motion of flights."""
    spent = set()
    for seed in range(6):
        fleet = Fleet(problem("microsat", "static", world(BLINDED)), 1, log=True)
        fleet.rows.plants["stream"][0] = np.random.default_rng(seed).integers(1, 2**64, 4, dtype=np.uint64)
        fleet.begin()
        plant = fleet.rows.plants[0]
        scenario = fleet.problem.scenario
        samples = [fleet.rows.logs[0, 0].copy()]
        shares = []
        for t in range(60):
            fleet.step(np.array([[0.06, -0.05, 0.04]], np.float32) * (-1.0 if t // 15 % 2 else 1.0))
            samples += list(fleet.rows.logs[0].copy())
            shares.append(float(fleet.rows.reports["tracking"][0]))
        log = np.array(samples)
        boresight = Rotation.from_quat(log["attitude"]).apply(np.array(BLINDED.boresight))
        angle = scenario.orbit_rate * log["time"]
        earth = np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
        limb = np.arcsin(EARTH_RADIUS / (EARTH_GRAVITY / scenario.orbit_rate**2) ** (1.0 / 3.0))
        reasons = {
            "rate": np.linalg.norm(log["rate"], axis=1) > BLINDED.rate_limit,
            "sun": np.arccos(boresight @ plant["tracker"]["sun"]) < BLINDED.sun_exclusion,
            "earth": np.arccos((boresight * earth).sum(axis=1)) < limb + BLINDED.earth_exclusion,
        }
        spent |= {name for name, blind in reasons.items() if blind.any()}
        blind = np.logical_or.reduce(list(reasons.values()))
        waited = round(BLINDED.reacquire / scenario.sample_period)
        tracks = ~np.array([blind[max(0, k - waited + 1) : k + 1].any() for k in range(len(blind))])
        due = np.arange(len(log)) % round(BLINDED.period / scenario.sample_period) == 0
        np.testing.assert_array_equal(np.isfinite(log["star_tracker"]).all(axis=1), tracks & due)
        np.testing.assert_allclose(shares, tracks[1:].reshape(60, -1).mean(axis=1))
    assert spent == {"rate", "sun", "earth"}


def test_the_sun_is_drawn_only_where_it_blinds():
    """And after everything else, so that the episode is the same with and without."""
    plain, seeing, blinded = (SatInertiaIDEnv(scenario=own) for own in ("default", world(), world(BLINDED)))
    for env in (plain, seeing, blinded):
        env.reset(seed=3)
    for name in ("inertia", "attitude", "rate", "wheel_speed"):
        np.testing.assert_array_equal(seeing.fleet.rows.plants[name], plain.fleet.rows.plants[name])
        np.testing.assert_array_equal(seeing.fleet.rows.plants[name], blinded.fleet.rows.plants[name])
    np.testing.assert_array_equal(seeing.fleet.rows.plants["gyro_bias"], blinded.fleet.rows.plants["gyro_bias"])
    assert np.linalg.norm(blinded.fleet.rows.plants["tracker"]["sun"][0]) == pytest.approx(1.0)
    assert not seeing.fleet.rows.plants["tracker"]["sun"].any()
    sun, force = (blinded.fleet.rows.plants[part][0] for part in ("tracker", "solar_force"))
    np.testing.assert_allclose(force, -np.linalg.norm(force) * sun["sun"], rtol=1e-12)  # light comes from the Sun


# belief


@pytest.mark.parametrize(
    ("satellite", "tolerances"),
    [(SATELLITES["microsat"], BIAS), (with_panels(), BIAS), (SATELLITES["microsat"], SCALES)],
    ids=["rigid", "panels", "scales"],
)
def test_compiled_equals_filterpy(satellite, tolerances):
    own = world(tolerances=tolerances)
    flown = record(
        make_baseline("rate_square", "microsat"),
        satellite=satellite,
        inertia="drift",
        seeds=[90_001],
        scenario=own,
        estimator={"name": "momentum", "inflate": False},
    )
    prior = prior_of(satellite, own)
    fast, slow, compared = MomentumEKF(inflate=False), FilterpyMomentumEKF(), 0
    for k in range(flown.gyro.shape[1]):
        gyro, speed, attitude = flown.gyro[0, k], flown.tachometer[0, k], flown.star_tracker[0, k]
        for estimator in (fast, slow):
            if k == 0:
                estimator.reset(prior, gyro, speed)
            else:
                estimator.predict(speed, flown.dt)
        if k > 0:
            assert fast.update(gyro, speed) == pytest.approx(slow.update(gyro, speed), rel=1e-7, abs=1e-12)
        if np.isfinite(attitude).all():
            nis = fast.update_attitude(attitude)
            assert nis == pytest.approx(slow.update_attitude(attitude), rel=1e-7, abs=1e-12)
            compared += nis > 0.0
        std = np.sqrt(np.maximum(np.diag(slow.covariance), 1e-300))
        assert np.abs(fast.mean - slow.mean).max() <= 1e-9 * np.abs(slow.mean).max()
        assert np.all(np.abs(fast.mean - slow.mean) <= 1e-7 * std), k
        assert np.all(np.abs(fast.covariance - slow.covariance) <= 1e-7 * np.outer(std, std)), k
        turn = Rotation.from_quat(fast.record["attitude"]["quaternion"]).inv() * slow.model.attitude
        assert turn.magnitude() < 1e-9
    assert compared > 100


def test_derivatives_are_those_of_finite_differences(prior):
    model = AttitudeModel(MomentumEKFSettings(parameters="full"), prior)
    generator = np.random.default_rng(0)
    w0, w1 = np.array([50.0, -80.0, 120.0]), np.array([55.0, -70.0, 110.0])
    x, covariance = model.start(np.array([0.01, -0.02, 0.015]), w0)
    x = x + np.sqrt(np.diag(covariance)) * generator.normal(size=model.size)
    x[model.psi] = 0.0
    first = Rotation.random(random_state=0)
    scale = np.sqrt(np.diag(covariance)) + 1e-9
    scale[model.psi] = 1e-3

    def stepped(state):
        """State after a step from an attitude that is off by its psi; psi is how far the attitude then is off."""
        model.attitude = Rotation.from_rotvec(state[model.psi]) * first
        model.turn(state, w0, w1, 0.1)
        after = model.step(state, w0, w1, 0.1)
        after[model.psi] = (model.attitude * middle.inv()).as_rotvec()
        return after

    model.attitude = first
    model.turn(x, w0, w1, 0.1)
    middle, model.attitude = model.attitude, first
    jacobian = model.step_jacobian(x, w0, w1, 0.1)
    for j in range(model.size):
        h = np.zeros(model.size)
        h[j] = 1e-3 * scale[j]
        slope = (stepped(x + h) - stepped(x - h)) / (2.0 * h[j])
        np.testing.assert_allclose(jacobian[:, j] * scale[j], slope * scale[j], rtol=1e-5, atol=1e-8, err_msg=str(j))


@pytest.mark.compiled
@pytest.mark.parametrize(
    "satellite",
    [SATELLITES["microsat"], pytest.param(with_panels(), marks=pytest.mark.slow)],
    ids=["rigid", "panels"],
)
@cases("inertia", ["static", "step", "drift", "periodic"])
def test_it_is_consistent_and_what_it_sees_helps(satellite, inertia):
    """Mean NEES of 40 episodes, with the tracker and where it is blind all the time."""

    def scores(tracker):
        policy = make_baseline("rate_square", "microsat")
        chosen = {"satellite": satellite, "inertia": inertia, "seeds": seeds("validation", 40)}
        return fly(policy, scenario=world(tracker, horizon=300.0), **chosen).scores()

    seeing, blind = scores(TRACKER), scores(TRACKER.replace(rate_limit=1e-9))
    assert 0.3 < seeing["nees"].mean() < 2.0
    assert 0.3 < blind["nees"].mean() < 2.0
    assert seeing["final_error"].mean() < (0.95 if inertia == "periodic" else 0.85) * blind["final_error"].mean()


@pytest.mark.slow
def test_it_is_consistent_with_readings_that_are_late_averaged_and_counted():
    """The tracker reads the present, the state is older; yet it helps as much as with readings of an instant."""

    def scores(tracker):
        own = late_world(horizon=300.0).replace(sensors=LATE.replace(star_tracker=tracker))
        policy, chosen = make_baseline("rate_square", "microsat"), seeds("validation", 40)
        return fly(policy, satellite="microsat", inertia="static", scenario=own, seeds=chosen).scores()

    seeing, blind = scores(TRACKER), scores(TRACKER.replace(rate_limit=1e-9))
    assert 0.3 < seeing["nees"].mean() < 1.2
    assert 0.3 < blind["nees"].mean() < 1.2
    assert seeing["final_error"].mean() < 0.65 * blind["final_error"].mean()


@pytest.mark.slow
def test_the_motors_noise_does_not_spoil_readings_that_wait():
    """Cubesat in slow motion: compared at once, by the commands of 1.4 samples, they left four times the error."""

    def error(tracker):
        own = late_world(horizon=300.0).replace(sensors=LATE.replace(star_tracker=tracker))
        policy, chosen = make_baseline("sine", "cubesat"), seeds("validation", 20)
        scores = fly(policy, satellite="cubesat", inertia="static", scenario=own, seeds=chosen).scores()
        assert 0.3 < scores["nees"].mean() < 1.2
        return scores["final_error"].mean()

    assert error(TRACKER) < 0.6 * error(TRACKER.replace(rate_limit=1e-9))


@pytest.mark.compiled
@cases("fault", ["gyro_dropout", "tachometer_stuck", "gyro_outlier"])
def test_with_a_gate_it_is_consistent_where_sensors_fail(fault):
    """Also while the gyro says nothing for 20 s, when the tracker alone shows how the body turns."""

    def scores(tracker):
        faults = SCENARIOS["faults"].faults.only(fault)
        own = SCENARIOS["faults"].replace(faults=faults, tolerances=BIAS, sensors=Sensors(star_tracker=tracker))
        policy = make_baseline("rate_square", "microsat")
        return fly(policy, satellite="microsat", inertia="drift", seeds=seeds("validation", 40), scenario=own).scores()

    seeing, blind = scores(TRACKER), scores(TRACKER.replace(rate_limit=1e-9))
    nees, less = seeing["nees"], seeing["final_error"].mean() / blind["final_error"].mean()
    print(f"{fault}: NEES {nees.mean():.2f}, at most {nees.max():.2f}; error over that of a blind tracker {less:.2f}")
    assert 0.3 < nees.mean() < 2.0
    assert nees.max() < 4.0
    assert less < 0.9


@pytest.mark.compiled
@cases("how", ["off now and then", "stuck"])
def test_the_gate_keeps_wrong_readings_out(how):
    """One reading in twenty off by a milliradian to half a turn, or one that is repeated for 20 s."""
    policy = make_baseline("rate_square", "microsat")
    flown = record(policy, satellite="microsat", inertia="static", seeds=[90_002], scenario=world())
    prior, generator = prior_of(SATELLITES["microsat"], world()), np.random.default_rng(0)
    wrong = flown.star_tracker[0].copy()
    given = np.flatnonzero(np.isfinite(wrong).all(axis=1))
    if how == "stuck":
        wrong[given[40:80]] = wrong[given[40]]
    else:
        for k in generator.choice(given[1:], len(given) // 20, replace=False):
            turn = Rotation.from_rotvec(10.0 ** generator.uniform(-3.0, 0.5) * direction(generator))
            wrong[k] = (turn * Rotation.from_quat(wrong[k])).as_quat()

    def filtered(attitude, gate):
        ekf = AdaptiveEKF(gate=gate)
        ekf.reset(prior, flown.gyro[0, 0], flown.tachometer[0, 0])
        for k in range(1, flown.gyro.shape[1]):
            ekf.predict(flown.tachometer[0, k], flown.dt)
            ekf.update(flown.gyro[0, k], flown.tachometer[0, k])
            if np.isfinite(attitude[k]).all():
                ekf.update_attitude(attitude[k])
        return ekf

    good = filtered(flown.star_tracker[0], 1e-6)
    std = np.sqrt(np.diag(good.covariance)[3:6])
    off = {gate: np.abs((filtered(wrong, gate).mean - good.mean)[3:6] / std).max() for gate in (0.0, 1e-6)}
    assert off[1e-6] < 1.5
    assert off[0.0] > 5.0
    assert filtered(wrong, 1e-6).record["rejected"] >= (39 if how == "stuck" else 5)
    assert good.record["rejected"] == 0


@pytest.mark.compiled
@cases("convention", ["right", "inertial to body", "scalar first", "axes of another frame"])
def test_a_pilot_survives_a_wrong_convention_of_the_attitude_by_its_gate_and_tells_of_it_without(convention):
    """It never fits the gyro, so all but the first of three in a row are rejected; without a gate there is an alarm."""
    turned = {
        "right": lambda q: q,
        "inertial to body": lambda q: np.r_[-q[:3], q[3]],
        "scalar first": lambda q: np.r_[q[3], q[:3]],
        "axes of another frame": lambda q: (Rotation.from_quat(q) * Rotation.from_rotvec([0.0, 0.0, 1.5])).as_quat(),
    }[convention]
    policy = make_baseline("rate_square", "microsat")
    flown = record(policy, satellite="microsat", inertia="static", seeds=[90_003], scenario=world())
    errors, alarms = [], []
    for gate in (0.0, 1e-6):
        pilot = Pilot("microsat", "rate_square", scenario=world(), estimator={"name": "adaptive", "gate": gate})
        given = [None if np.isnan(q).any() else turned(q) for q in flown.star_tracker[0]]
        pilot.start(0.0, flown.gyro[0, 0], flown.tachometer[0, 0], given[0])
        for k in range(1, len(given)):
            pilot.step(k * flown.dt, flown.gyro[0, k], flown.tachometer[0, k], given[k])
        truth = np.diag(flown.motion.inertia[0, -1])
        errors.append(np.abs(pilot.estimate.theta / truth - 1.0).max())
        alarms.append(pilot.estimate.unmodelled)
    assert errors[1] < 1e-3
    assert (pilot.status.counts["rejected"] > 50) == (convention != "right")
    assert alarms == [convention != "right", False]
    assert convention == "right" or errors[0] > 0.1


def direction(generator):
    """Unit vector."""
    v = generator.normal(size=3)
    return v / np.linalg.norm(v)


@pytest.mark.compiled
def test_the_attitude_outlives_a_step_of_the_inertia():
    """The step comes within a sample, which the tracker's next reading ends: the rate was wrong for a part of it."""
    tracker = TRACKER.replace(period=0.1, rate_limit=None)
    settings = {"scenario": world(tracker, decision_period=0.1), "control": "rate", "observation": "body"}
    env = SatInertiaIDVectorEnv(12, "microsat", InertiaLaw("step", size=0.1, time=40.03), **settings)
    policy = make_baseline("rate_square", "microsat")
    policy.reset(missions(env.problem)[0], range(12))
    observation, _ = env.reset(seed=seeds("validation", 12))
    rows, nees = env.fleet.rows, []
    first = rows.beliefs["attitude"]["first"][0]
    for t in range(600):
        observation, *_ = env.step(policy(observation))
        if t >= 390:
            assert rows.beliefs["attitude"]["known"].all()
            believed = Rotation.from_quat(rows.beliefs["attitude"]["quaternion"])
            psi = (Rotation.from_quat(rows.plants["attitude"]) * believed.inv()).as_rotvec()
            covariance = rows.beliefs["covariance"][:, first : first + 3, first : first + 3]
            nees.append(np.einsum("ni,nij,nj->n", psi, np.linalg.inv(covariance), psi) / 3.0)
    env.close()
    assert rows.beliefs["adaptation"]["steps"].tolist() == [1] * 12
    before, at_once, later = np.mean(nees[:10]), np.max(np.mean(nees[10:15], axis=1)), np.mean(nees[15:])
    print(f"attitude NEES {before:.2f} before the step, at most {at_once:.2f} at once, {later:.2f} later")
    assert 0.3 < before < 2.0
    assert at_once < 10.0
    assert 0.3 < later < 2.0


# interface


def test_the_observation_has_what_is_known_of_the_attitude():
    env = SatInertiaIDEnv(scenario=world(BLINDED), inertia="static", include_covariance=True)
    observation, info = env.reset(seed=4)
    assert list(env.layout)[-6:] == [
        "attitude_uncertainty",
        "attitude_age",
        "sun",
        "earth",
        "state_uncertainty",
        "state_correlation",
    ]
    known = set()
    for t in range(40):
        observation, _, _, _, info = env.step(np.array([0.02, 0.02, 0.02], np.float32) * (-1.0 if t // 20 else 1.0))
        belief = env.fleet.rows.beliefs[0]
        own, first = belief["attitude"], belief["attitude"]["first"]
        std = observed_std(observation[env.layout["attitude_uncertainty"]].astype(float))
        if own["known"]:
            R = Rotation.from_quat(own["quaternion"]).as_matrix()
            block = R.T @ belief["covariance"][first : first + 3, first : first + 3] @ R
            np.testing.assert_allclose(std, np.sqrt(np.diag(block)), rtol=1e-5)
            true = Rotation.from_quat(env.fleet.rows.plants["attitude"][0])
            assert (true * Rotation.from_quat(own["quaternion"]).inv()).magnitude() < 6.0 * np.linalg.norm(std)
        else:
            np.testing.assert_allclose(std, 1.0, rtol=1e-5)
        assert observation[env.layout["attitude_age"]][0] == pytest.approx(min(own["age"], 10.0), abs=1e-5)
        known.add(bool(own["known"]))
        assert 0.0 <= info["tracking"] <= 1.0
    assert True in known


def sky(env):
    """Directions of Sun and Earth in the body frame, true."""
    plant = env.fleet.rows.plants[0]
    angle = plant["orbit_rate"] * plant["time"]
    to_body = Rotation.from_quat(plant["attitude"]).inv()
    return to_body.apply([plant["tracker"]["sun"], [np.cos(angle), np.sin(angle), 0.0]])


def test_sun_and_earth_are_observed_as_well_as_the_attitude_is_known():
    """By the estimated attitude: within its standard deviations of where they are, and 0 before the first reading."""
    known = set()
    for seed in range(4):
        env = SatInertiaIDEnv(scenario=world(BLINDED), inertia="static")
        observation, _ = env.reset(seed=seed)
        for t in range(30):
            seen = np.array([observation[env.layout[name]] for name in ("sun", "earth")], float)
            if env.fleet.rows.beliefs[0]["attitude"]["known"]:
                np.testing.assert_allclose(np.linalg.norm(seen, axis=1), 1.0, rtol=1e-6)
                std = observed_std(observation[env.layout["attitude_uncertainty"]].astype(float))
                assert np.linalg.norm(seen - sky(env), axis=1).max() < 6.0 * np.linalg.norm(std) + 1e-6
                known.add(True)
            else:
                np.testing.assert_array_equal(seen, 0.0)
                known.add(False)
            observation, *_ = env.step(np.array([0.02, 0.02, 0.02], np.float32) * (-1.0 if t // 15 else 1.0))
    assert known == {True, False}


def test_only_what_blinds_the_tracker_is_observed():
    for changes, names in [
        ({}, {"sun", "earth"}),
        ({"sun_exclusion": None}, {"earth"}),
        ({"earth_exclusion": None}, {"sun"}),
        ({"sun_exclusion": None, "earth_exclusion": None}, set()),
    ]:
        layout = problem("microsat", "static", world(BLINDED.replace(**changes))).layout
        assert set(layout) & {"sun", "earth"} == names
    sheets = [
        SATELLITES[name].replace(sensors=Sensors(star_tracker=tracker))
        for name, tracker in (("microsat", BLINDED), ("smallsat", BLINDED.replace(sun_exclusion=None)))
    ]
    with pytest.raises(ValueError, match=r"need star trackers that the same bodies blind.*microsat, smallsat"):
        problem(sheets)
    env = SatInertiaIDEnv(sheets[0])
    with pytest.raises(ValueError, match="sensors like the environment's"):
        env.reset(options={"satellite": sheets[1]})


def flights(scenario, **settings):
    """Observations, rewards and shares of tracking of the single environment."""
    env = SatInertiaIDEnv("microsat", "step", scenario, **settings)
    found = [(env.reset(seed=6)[0], 0.0, 0.0)]
    for _ in range(15):
        observation, reward, _, _, info = env.step(ACTION)
        found.append((observation, reward, info["tracking"]))
    return found


ACTION = np.array([0.02, -0.01, 0.03], np.float32)


def test_single_and_vector_environment_fly_the_same():
    many = SatInertiaIDVectorEnv(3, "microsat", "step", world(BLINDED))
    single = flights(world(BLINDED))
    np.testing.assert_array_equal(single[0][0], many.reset(seed=5)[0][1])
    for observation, reward, tracking in single[1:]:
        vector, rewards, _, _, infos = many.step(np.tile(ACTION, (3, 1)))
        np.testing.assert_array_equal(observation, vector[1])
        assert (reward, tracking) == (rewards[1], infos["tracking"][1])
    many.close()


@cases("scenario", ["as the data sheet says", "a gyro that is silent", "readings that are late"])
def test_an_estimator_of_the_users_own_flies_the_same(scenario):
    silent = {"gyro_dropout": 1.0, "gyro_dropout_duration": (5.0, 8.0), "time": (0.1, 0.1)}
    own_world = {
        "as the data sheet says": world(BLINDED),
        "a gyro that is silent": world(faults=silent),
        "readings that are late": late_world(),
    }[scenario]
    for own, core in zip(flights(own_world, estimator=AdaptiveEKF()), flights(own_world), strict=True):
        np.testing.assert_allclose(own[0], core[0], rtol=1e-6, atol=1e-6)
        assert own[1:] == pytest.approx(core[1:], rel=1e-9)


def test_a_pilot_believes_what_the_environment_does():
    settings = {"inertia": "static", "scenario": world(BLINDED.replace(rate_limit=0.05, reacquire=0.2))}
    policy = make_baseline("rate_square", "microsat")
    fleet = Fleet(problem("microsat", **settings), 1, log=True)
    fleet.rows.plants["stream"][0] = np.random.default_rng(1).integers(1, 2**64, 4, dtype=np.uint64)
    fleet.begin()
    pilot = Pilot("microsat", make_baseline("rate_square", "microsat"), scenario=settings["scenario"])
    policy.reset(missions(fleet.problem)[0], [0])
    sample, taken = 0, 0
    log = fleet.rows.logs[0, 0]
    with pytest.raises(ValueError, match="sun must be a direction"):
        pilot.start(0.0, log["gyro"], log["tachometer"], sun=[0.0, 0.0, 0.0])
    pilot.start(0.0, log["gyro"], log["tachometer"], log["star_tracker"], sun=3.0 * fleet.rows.tasks["sun"][0])
    for _ in range(30):
        action = policy(fleet.rows.observations.copy()).astype(np.float32)
        fleet.step(action)
        for log in fleet.rows.logs[0]:
            sample, last = sample + 1, pilot.step
            attitude = None if np.isnan(log["star_tracker"]).all() else log["star_tracker"]
            taken += attitude is not None
            torque = last(sample * 0.1, log["gyro"], log["tachometer"], attitude)
        belief = fleet.rows.beliefs[0]
        np.testing.assert_allclose(pilot.estimate.mean, belief["mean"], rtol=1e-9, atol=1e-12)
        scale = np.diag(belief["covariance"]).max()
        here = [pilot.problem.layout[name] for name in ("sun", "earth")]
        for place in here:
            np.testing.assert_allclose(pilot._observation[0, place], fleet.rows.observations[0, place], atol=1e-6)
        assert np.abs(pilot.estimate.state_covariance - belief["covariance"]).max() <= 1e-9 * scale
    assert taken > 10
    assert np.isfinite(torque).all()
    before = pilot.status.counts["refused"]
    pilot.step((sample + 1) * 0.1, log["gyro"], log["tachometer"], [10.0, 20.0, 30.0, 0.0])
    assert pilot.status.counts["refused"] == before + 1
    assert "attitude" in pilot.status.message
    pilot.step((sample + 5) * 0.1, log["gyro"], log["tachometer"])  # the wheels may have done anything in between
    assert not pilot._beliefs["attitude"]["known"][0]


def test_a_data_sheet_keeps_its_tracker(tmp_path):
    sheet = SATELLITES["microsat"].replace(sensors=Sensors(star_tracker=BLINDED))
    again = Satellite.from_dict(sheet.to_dict())
    assert again.to_dict() == sheet.to_dict()
    np.testing.assert_allclose(again.sensors.star_tracker.boresight, [0.6, 0.0, 0.8])


# what cannot be


@cases(
    ("settings", "message"),
    [
        ({"boresight": [0.0, 0.0, 0.0]}, "must be a direction"),
        ({"boresight": [1.0, 0.0]}, "shape"),
        ({"across_std": -1e-5}, "across_std of the star tracker"),
        ({"round_std": 0.1}, "round_std of the star tracker"),
        ({"period": 0.0}, "period of the star tracker"),
        ({"rate_limit": 0.0}, "rate_limit of the star tracker"),
        ({"reacquire": -1.0}, "reacquire of the star tracker"),
        ({"sun_exclusion": 2.0}, "sun_exclusion of the star tracker"),
        ({"period": 0.05}, "multiple of the sample period, 0.1 s, got 0.05"),
        ({"period": 0.25}, "multiple of the sample period"),
        ({"sun_exclusion": 1.5, "earth_exclusion": 1.0}, "must leave some sky"),
    ],
)
def test_a_data_sheet_that_cannot_be_is_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        problem("microsat", "static", world(StarTracker(**settings)))


def test_what_takes_no_star_tracker_says_so(prior):
    gyro, speed = np.zeros(3), np.zeros(3)
    for make in (
        lambda: RateEKF().reset(prior, gyro, speed),
        lambda: FilterpyMomentumEKF(gate=0.001, calibrate=False).reset(prior, gyro, speed),
        lambda: FilterpyAdaptiveEKF().reset(prior, gyro, speed),
        lambda: FilterpyMomentumUKF().reset(prior, gyro, speed),
        lambda: MomentumSmoother(calibrate=False).run(prior, gyro[None], speed[None], 0.1),
        lambda: SatInertiaIDEnv(scenario=world(), estimator=FilterpyMomentumEKF()),
        lambda: SatInertiaIDVectorEnv(2, ["microsat", _tracked("cubesat")], "static"),
    ):
        with pytest.raises(ValueError, match=r"star.tracker"):
            make()
    with pytest.raises(ValueError, match="has no star tracker"):
        Pilot("microsat", "rate_square").start(0.0, gyro, speed, [0.0, 0.0, 0.0, 1.0])
    late = Sensors(star_tracker=TRACKER, tachometer_delay=1.0)
    with pytest.raises(ValueError, match="needs the prior's sample_period"):
        MomentumEKF().reset(prior.replace(sensors=late, sample_period=None), gyro, speed)


def _tracked(name):
    return SATELLITES[name].replace(sensors=Sensors(star_tracker=TRACKER))
