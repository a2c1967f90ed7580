"""Sensors of a data sheet: what late, averaged and counted readings are, and a filter that is consistent with them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from baselines.command.cli import UserError
from baselines.studies.consistency import ConsistencyStudy, cell
from baselines.studies.consistency import main as consistency_main
from baselines.studies.recording import record
from satid_gym import SATELLITES, SatInertiaIDEnv, SatInertiaIDVectorEnv, Scenario, Sensors, Tolerances, simulate
from satid_gym.core import kernels
from satid_gym.estimators import AdaptiveEKF, FilterpyMomentumEKF, MomentumEKF, MomentumSmoother, RateEKF
from satid_gym.evaluation import fly, seeds
from satid_gym.policies.registry import make_baseline
from satid_gym.policy import missions
from satid_gym.problem import problem
from satid_gym.scenario import prior_of

pytestmark = pytest.mark.interpreted

QUIET = {
    "gyro_noise_std": 0.0,
    "gyro_bias_walk": 0.0,
    "tachometer_noise_std": 0.0,
    "torque_noise": 0.0,
    "disturbance_scale": 0.0,
    "gravity_gradient": False,
    "solar_pressure": 0.0,
    "estimator": "momentum",
}
FINE = 60  # instants in a sample period, at which the trajectory is known


def flown(sensors, period=0.1, decisions=30, **settings):
    """Readings (T, 3) and (T, n) of a quiet flight, and its trajectory from `simulate` at T FINE + 1 instants."""
    env = SatInertiaIDEnv(
        "microsat", "static", {**QUIET, "sensors": sensors, "sample_period": period, "horizon": 600.0, **settings}
    )
    env.reset(seed=3)
    plant, generator = env.fleet.rows.plants[0], np.random.default_rng(0)
    start = plant["rate"].copy(), plant["wheel_speed"].copy(), plant["inertia"].copy()
    gyro, tachometer, torque = [plant["gyro"].copy()], [plant["tachometer"].copy()], []
    left = plant["sampling"]["wheel_left"].copy()
    for _ in range(decisions):
        env.fleet.work["torque"][0] = command = generator.uniform(-0.1, 0.1, 3)
        kernels.sample(env.fleet.rows, env.fleet.work)
        torque.append(command)
        gyro.append(plant["gyro"].copy())
        tachometer.append(plant["tachometer"].copy())
    satellite = SATELLITES["microsat"].replace(inertia=start[2])
    path = simulate(satellite, np.repeat(torque, FINE, axis=0), period / FINE, omega0=start[0], wheel_speed0=start[1])
    delay = float(plant["sampling"]["tachometer_delay"])
    return np.array(gyro), np.array(tachometer), path, left, delay


def integral(values, step):
    """Integral (T, ...) from the start to each instant of values that are smooth within a sample, by splines."""
    total = [np.zeros((1, *values.shape[1:]))]
    instants = step * np.arange(FINE + 1)
    for first in range(0, len(values) - 1, FINE):
        own = CubicSpline(instants, values[first : first + FINE + 1]).antiderivative()(instants[1:])
        total.append(total[-1][-1] + own)
    return np.concatenate(total)


@pytest.mark.parametrize(("period", "error"), [(0.1, 1e-10), (1.0, 2e-8)])
def test_an_integrating_gyro_reads_the_mean_rate(period, error):
    """Against the integral of a trajectory that is known at 60 instants a sample; the error is the integrator's."""
    gyro, tachometer, path, *_ = flown({"gyro_integrates": True}, period)
    turned = integral(path.omega, period / FINE)[::FINE]
    np.testing.assert_allclose(gyro[1:], np.diff(turned, axis=0) / period, rtol=0.0, atol=error)
    assert np.abs(gyro[1:] - path.omega[FINE::FINE]).max() > 1e-4
    np.testing.assert_allclose(tachometer, path.wheel_speed[::FINE], rtol=1e-9)


def test_late_readings_are_those_of_earlier_instants():
    """Fractions of a sample too: the gyro a quarter of a sample and its mean, the tachometers one and a half."""
    gyro, tachometer, path, *_ = flown({"gyro_integrates": True, "gyro_delay": 0.25, "tachometer_delay": 1.5})
    turned = integral(path.omega, 0.1 / FINE)
    first = FINE - FINE // 4
    means = (turned[first + FINE :: FINE] - turned[first:-FINE:FINE]) / 0.1
    np.testing.assert_allclose(gyro[2:], means[: len(gyro) - 2], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(tachometer[2:], path.wheel_speed[FINE // 2 :: FINE][: len(gyro) - 2], rtol=1e-9)


def test_an_encoder_counts_pulses_and_carries_over():
    """The sum of all counts is the wheel's angle to within one pulse, at every sample."""
    _, tachometer, path, left, _ = flown({"encoder_pulses": 24})
    pulse = 2.0 * np.pi / 24
    counts = tachometer[1:] * 0.1 / pulse
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    angle = left + integral(path.wheel_speed, 0.1 / FINE)[FINE::FINE]
    np.testing.assert_array_equal(np.cumsum(np.round(counts), axis=0), np.floor(angle / pulse))


def test_quanta_carry_over_and_a_gyro_beyond_its_range_says_so():
    quantum = 5e-5
    gyro, _, path, *_ = flown({"gyro_integrates": True, "gyro_quantum": quantum})
    counts = gyro * 0.1 / quantum
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-8)
    turned = integral(path.omega, 0.1 / FINE)[FINE::FINE]
    assert np.abs(np.cumsum(gyro[1:], axis=0) * 0.1 - turned).max() <= quantum
    env = SatInertiaIDEnv("microsat", "static", {**QUIET, "sensors": {"gyro_range": 0.031}, "termination_factor": 9.0})
    env.reset(seed=0)
    plant, belief = env.fleet.rows.plants[0], env.fleet.rows.beliefs[0]
    seen = []
    for _ in range(12):
        env.step(np.array([1.0, 0.0, 0.0], np.float32))
        beyond = np.abs(plant["rate"]).max() >= 0.031
        assert plant["gyro_flagged"] == belief["coasting"] == beyond
        assert np.abs(plant["gyro"]).max() <= 0.031
        seen.append(beyond)
    assert not all(seen)
    assert any(seen)


def test_by_default_nothing_is_drawn_and_nothing_is_different():
    told = [Scenario(), Scenario(sensors=Sensors()), Scenario(sensors=Sensors(gyro_range=1.0))]
    flights = []
    for scenario in told:
        env = SatInertiaIDEnv("microsat", scenario=scenario)
        rows = [env.reset(seed=3)[0]]
        rows += [env.step(np.full(3, 0.2, np.float32))[0] for _ in range(3)]
        flights.append(np.array(rows).tobytes())
    assert flights[0] == flights[1] == flights[2]


def test_the_unknown_part_of_a_delay_has_its_tolerance():
    env = SatInertiaIDVectorEnv(
        2000, "microsat", "static", {"sensors": {"tachometer_delay": 1.0}, "tolerances": {"tachometer_delay": 0.2}}
    )
    env.reset(seed=0)
    drawn = env.fleet.rows.plants["sampling"]["tachometer_delay"]
    assert drawn.mean() == pytest.approx(1.0, abs=4.0 * 0.2 / np.sqrt(2000.0))
    assert drawn.std() == pytest.approx(0.2, rel=0.08)
    assert np.abs(drawn - 1.0).max() <= 0.6 + 1e-12
    env.close()


# belief


def readings(sensors, **settings):
    """Readings of a flight in closed loop, and the prior of its filter."""
    scenario = Scenario(sensors=Sensors(**sensors), horizon=60.0, **settings)
    recording = record(
        make_baseline("rate_square", "microsat"),
        satellite="microsat",
        inertia="static",
        seeds=[90_001],
        scenario=scenario,
    )
    return recording.gyro[0], recording.tachometer[0], prior_of(SATELLITES["microsat"], scenario)


@pytest.mark.parametrize(
    ("sensors", "align"),
    [
        ({"gyro_integrates": True}, lambda z, w: (z[1:], 0.5 * (w[1:] + w[:-1]))),
        ({"tachometer_delay": 1.0}, lambda z, w: (z[:-1], w[1:])),
        ({"tachometer_delay": 0.25}, lambda z, w: (0.75 * z[1:] + 0.25 * z[:-1], w[1:])),
        ({"gyro_delay": 2.0, "tachometer_delay": 2.0}, lambda z, w: (z[1:], w[1:])),
    ],
)
def test_it_is_the_plain_filter_on_readings_that_were_aligned_by_hand(sensors, align):
    gyro, tachometer, prior = readings(sensors)
    plain = prior.replace(sensors=Sensors())
    z, w = align(gyro, tachometer)
    expected = AdaptiveEKF().run(plain, np.vstack([gyro[:1], z]), np.vstack([tachometer[:1], w]), 0.1)
    aligned = AdaptiveEKF().run(prior, gyro, tachometer, 0.1)
    np.testing.assert_allclose(aligned.mean, expected.mean, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(aligned.covariance[-1], expected.covariance[-1], rtol=1e-9, atol=1e-24)


@pytest.mark.parametrize("integrates", [True, False])
def test_innovations_of_an_encoder_are_of_the_size_that_is_expected(integrates):
    """With the inertia known: mean normalised innovation squared of 600 samples."""
    gyro, tachometer, prior = readings({"gyro_integrates": integrates, "encoder_pulses": 24}, inertia_std=0.0)
    run = MomentumEKF(inertia_walk=0.0).run(prior.replace(prior_std=1e-7), gyro, tachometer, 0.1)
    nis = run.nis[20:]
    assert nis.mean() == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 3.0 / len(nis)))


WORLDS = {
    "integrating gyro": ({"gyro_integrates": True}, {}),
    "one sample late": ({"tachometer_delay": 1.0}, {}),
    "24 pulses": ({"gyro_integrates": True, "encoder_pulses": 24}, {}),
    "64 pulses, instantaneous gyro, 0.3 late": ({"encoder_pulses": 64, "tachometer_delay": 0.3}, {}),
    "unknown delay": ({"tachometer_delay": 0.9}, {"tachometer_delay": 0.3}),
    "quantum": ({"gyro_integrates": True, "gyro_quantum": 5e-6}, {}),
}


@pytest.mark.compiled
@pytest.mark.parametrize("world", WORLDS)
def test_it_is_consistent_where_the_data_sheet_tells_of_the_timing(world):
    """Mean NEES of 40 episodes."""
    sensors, tolerances = WORLDS[world]
    scores = fly(
        make_baseline("rate_square", "microsat"),
        satellite="microsat",
        inertia="static",
        seeds=seeds("validation", 40),
        scenario={"sensors": sensors, "tolerances": tolerances},
    ).scores()
    assert 0.3 < scores["nees"].mean() < 1.5
    assert scores["final_error"].mean() < 2e-4


@pytest.mark.parametrize(
    "sensors", [{"gyro_integrates": True}, {"tachometer_delay": 1.0}, {"encoder_pulses": 24, "gyro_integrates": True}]
)
def test_without_alignment_it_is_far_off(sensors):
    gyro, tachometer, prior = readings(sensors)
    run = AdaptiveEKF().run(prior.replace(sensors=Sensors()), gyro, tachometer, 0.1)
    aligned = AdaptiveEKF().run(prior, gyro, tachometer, 0.1)
    assert np.mean(run.nis[100:]) > 3.0 * np.mean(aligned.nis[100:])


def test_the_delay_is_found():
    env = SatInertiaIDEnv(
        "microsat", "static", {"sensors": {"tachometer_delay": 0.9}, "tolerances": {"tachometer_delay": 0.3}}
    )
    policy = make_baseline("rate_square", "microsat")
    policy.reset(missions(env.problem)[0], [0])
    observation, _ = env.reset(seed=5)
    for _ in range(60):
        observation, *_ = env.step(policy(observation[None])[0])
    belief, plant = env.fleet.rows.beliefs[0], env.fleet.rows.plants[0]
    place = belief["calibration"]["delay"]
    error = belief["mean"][place] - (plant["sampling"]["tachometer_delay"] - 0.9)
    std = np.sqrt(belief["covariance"][place, place])
    assert std < 0.01
    assert abs(error) < 4.0 * std


def test_the_observed_rate_is_that_of_the_present():
    """To the gyro's noise, where the reading is half a sample old and the motors turn the body with all they have."""
    env = SatInertiaIDEnv("microsat", "static", {"sensors": {"gyro_integrates": True, "gyro_delay": 1.0}})
    env.reset(seed=6)
    plant = env.fleet.rows.plants[0]
    stale, seen = [], []
    for i in range(12):
        observation, *_ = env.step(np.full(3, 0.9 if i // 2 % 2 else -0.9, np.float32))
        stale.append(plant["gyro"] - plant["rate"])
        seen.append(observation[env.layout["rate"]] * 0.03 - plant["rate"])
    assert np.sqrt(np.mean(np.square(stale))) > 1.5e-3
    assert np.sqrt(np.mean(np.square(seen[6:]))) < 3e-4


@pytest.mark.parametrize("sensors", [{"gyro_integrates": True, "encoder_pulses": 64}, {"tachometer_delay": 1.3}])
def test_single_vector_and_object_do_the_same(sensors):
    scenario = {"sensors": sensors, "horizon": 8.0}
    single = SatInertiaIDEnv("microsat", "step", scenario)
    own = SatInertiaIDEnv("microsat", "step", scenario, estimator=AdaptiveEKF())
    vector = SatInertiaIDVectorEnv(2, "microsat", "step", scenario)
    first = [env.reset(seed=7)[0] for env in (single, own)] + [vector.reset(seed=[7, 8])[0][0]]
    np.testing.assert_array_equal(first[0], first[1])
    np.testing.assert_array_equal(first[0], first[2])
    generator = np.random.default_rng(1)
    for _ in range(6):
        action = generator.uniform(-0.5, 0.5, 3).astype(np.float32)
        mine = single.step(action)
        np.testing.assert_array_equal(mine[0], vector.step(np.stack([action, action]))[0][0])
        theirs = own.step(action)
        shown = np.ones(len(mine[0]), bool)
        shown[single.layout["coast_rate_change"]] = False  # of the readings, by an object
        np.testing.assert_allclose(theirs[0][shown], mine[0][shown], rtol=1e-5, atol=1e-6)
        assert theirs[4]["nees"] == pytest.approx(mine[4]["nees"], rel=1e-6)
    vector.close()


# what is refused


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"gyro_delay": -0.1}, "gyro_delay, in sample periods, must be .* at least 0 and at most 4"),
        ({"tachometer_delay": 4.5}, "tachometer_delay, in sample periods, must be"),
        ({"encoder_pulses": 0}, "encoder_pulses must be an integer of at least 1, got 0"),
        ({"encoder_pulses": 24.5}, "encoder_pulses must be an integer"),
        ({"gyro_integrates": True, "gyro_quantum": -1e-6}, "gyro_quantum must be .* at least 0"),
        ({"gyro_quantum": 1e-6}, "needs gyro_integrates=True"),
        ({"gyro_range": 0.0}, "gyro_range must be .* more than 0"),
        ({"gyro_dely": 1.0}, "unknown .*gyro_dely.*gyro_delay"),
    ],
)
def test_sensors_that_cannot_be_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        Sensors.from_dict(settings)


def test_data_sheets_that_cannot_be_are_refused():
    microsat = SATELLITES["microsat"]
    with pytest.raises(ValueError, match=r"gyro_range of microsat must be more than its rate_limit, 0\.03"):
        microsat.replace(sensors=Sensors(gyro_range=0.02))
    with pytest.raises(ValueError, match=r"at most a third .* no reading comes before its time"):
        microsat.replace(sensors=Sensors(tachometer_delay=0.5), tolerances=Tolerances(tachometer_delay=0.2))
    with pytest.raises(ValueError, match="sensors must be Sensors or a mapping"):
        microsat.replace(sensors="good")
    with pytest.raises(ValueError, match=r"tachometer_delay must be .* at most 0\.5"):
        Tolerances(tachometer_delay=0.6)
    with pytest.raises(ValueError, match=r"need encoders or none.*give scenario sensors"):
        problem([microsat.replace(sensors=Sensors(encoder_pulses=24)), "cubesat"])


def test_an_episode_with_other_sensors_or_tolerances_is_refused():
    env = SatInertiaIDEnv("microsat", "static")
    for other in ({"sensors": Sensors(encoder_pulses=24)}, {"tolerances": Tolerances(gyro_bias=1e-4)}):
        with pytest.raises(ValueError, match=r"tolerances of the same kinds and sensors like the environment's"):
            env.reset(seed=0, options={"satellite": SATELLITES["microsat"].replace(**other)})


def test_filters_refuse_the_timing_that_they_do_not_know():
    prior = prior_of(SATELLITES["microsat"], Scenario(sensors=Sensors(gyro_integrates=True, encoder_pulses=24)))
    begun = [estimator.reset for estimator in (RateEKF(), FilterpyMomentumEKF())]
    for begin in (*begun, lambda *readings: MomentumSmoother().run(*readings, 0.1)):
        with pytest.raises(ValueError, match=r"read at one instant: .*neither integrate nor count, without delay"):
            begin(prior, np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match="sensors that count need the prior's sample_period"):
        prior.replace(sample_period=None)


# the study


@pytest.mark.compiled
def test_the_study_keeps_the_cells_of_other_worlds(tmp_path, monkeypatch):
    monkeypatch.setattr("baselines.command.provenance.revision", lambda _: "a1")
    settings = {
        "policies": ("zero",),
        "satellites": ("cubesat",),
        "inertias": ("static",),
        "episodes": 3,
        "output": tmp_path / "consistency.json",
    }
    assert consistency_main(ConsistencyStudy(worlds=("as nominal", "integrating gyro"), **settings)) == 0
    first = json.loads(settings["output"].read_text())
    monkeypatch.setattr("baselines.command.provenance.revision", lambda _: "b2")
    assert consistency_main(ConsistencyStudy(worlds=("integrating gyro",), merge=True, **settings)) == 0
    second = json.loads(settings["output"].read_text())
    assert second["settings"]["worlds"] == ["as nominal", "integrating gyro"]
    assert second["cells"] == [first["cells"][0], {**first["cells"][1], "revision": "b2"}]
    with pytest.raises(UserError, match="was flown with episodes = 3: give another --output"):
        consistency_main(ConsistencyStudy(worlds=("as nominal",), merge=True, **{**settings, "episodes": 2}))


@pytest.mark.compiled
def test_a_stopped_study_goes_on_with_the_cells_of_its_revision(tmp_path, monkeypatch):
    """Cells of another revision stay with --merge alone, and are replaced with --again alone."""

    def at(revision):
        monkeypatch.setattr("baselines.command.provenance.revision", lambda _: revision)

    at("a1")
    settings = {"policies": ("zero",), "satellites": ("cubesat",), "inertias": ("static",), "episodes": 2}
    worlds, output = ("as nominal", "integrating gyro"), tmp_path / "consistency.json"
    flown, stop = [], 2

    def fly_until_stopped(*arguments):
        flown.append(arguments)
        if len(flown) == stop:
            raise KeyboardInterrupt
        return cell(*arguments)

    monkeypatch.setattr("baselines.studies.consistency.cell", fly_until_stopped)
    study = ConsistencyStudy(worlds=worlds, output=output, **settings)
    with pytest.raises(KeyboardInterrupt, match="the same command goes on"):
        consistency_main(study)
    (first,) = json.loads(output.read_text())["cells"]
    assert first["revision"] == "a1"
    flown, stop = [], None
    assert consistency_main(study) == 0
    assert len(flown) == 1
    both = json.loads(output.read_text())["cells"]
    assert [own["world"] for own in both] == list(worlds)
    assert both[0] == first

    at("b2")
    second = replace(study, worlds=worlds[1:])
    for other, said in ((study, "revision = a1"), (second, "other worlds, revision = a1")):
        with pytest.raises(UserError, match=f"was flown with {said}: give another --output, or --again"):
            consistency_main(other)
    assert consistency_main(replace(second, merge=True)) == 0
    assert [own["revision"] for own in json.loads(output.read_text())["cells"]] == ["a1", "b2"]
    flown = []
    assert consistency_main(replace(second, merge=True)) == 0
    assert not flown, "it is of this revision"
    assert consistency_main(replace(second, merge=True, again=True)) == 0
    assert len(flown) == 1
    assert len(json.loads(output.read_text())["cells"]) == 2
    assert consistency_main(replace(second, again=True)) == 0
    assert [own["world"] for own in json.loads(output.read_text())["cells"]] == [worlds[1]]

    at("b2-dirty")
    flown = []
    assert consistency_main(replace(second, merge=True)) == 0
    assert consistency_main(replace(second, merge=True)) == 0
    assert len(flown) == 2, "the code may have changed meanwhile"
