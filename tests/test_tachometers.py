"""Gate with readings that are averaged, counted or late: outliers, outages, and encoders that are stuck."""

import numpy as np
import pytest

from satid_gym import SATELLITES, SCENARIOS, SatInertiaIDVectorEnv, Sensors
from satid_gym.estimators import MomentumEKF
from satid_gym.scenario import prior_of
from tests.cases import cases
from tests.test_sensor_faults import GATE, HARD, square, world

INTEGRATING = Sensors(gyro_integrates=True)
LATE = Sensors(tachometer_delay=2.5, gyro_delay=0.3)
COUNTING = Sensors(encoder_pulses=64, tachometer_delay=0.5)
ALL = {name: value for part in HARD.values() for name, value in part.items()}


def flown(sensors, estimator=GATE, inertia="static", decisions=120, horizon=120.0, count=40, **faults):
    """Environments after a flight of square waves of torque, and NEES, error and mean of each decision."""
    scenario = world(horizon, **faults).replace(sensors=sensors)
    envs = SatInertiaIDVectorEnv(count, "microsat", inertia, scenario, estimator=estimator)
    envs.reset(seed=0)
    seen = {"nees": [], "relative_error": [], "mean": []}
    for t in range(decisions):
        *_, info = envs.step(np.tile(square(t), (count, 1)))
        seen["nees"].append(info["nees"])
        seen["relative_error"].append(info["relative_error"])
        seen["mean"].append(envs.fleet.rows.beliefs["mean"].copy())
    return envs, {name: np.array(values) for name, values in seen.items()}


def encoder_filter():
    """A gated filter of microsat with encoders, at its first reading: wheels that turn by 20 pulses a sample."""
    sheet = SATELLITES["microsat"].replace(sensors=Sensors(encoder_pulses=64))
    ekf, quantum = MomentumEKF(gate=1e-6), 2.0 * np.pi / 64 / 0.1
    ekf.reset(prior_of(sheet, SCENARIOS["default"]), np.zeros(3), np.full(3, 20.0 * quantum))
    return ekf, quantum, sheet.wheels


@pytest.mark.compiled
@pytest.mark.parametrize(
    ("sensors", "faults"),
    [
        (COUNTING, "tachometer_stuck"),
        (LATE, "gyro_outlier"),
        *(pytest.param(sensors, "all", marks=pytest.mark.slow) for sensors in (INTEGRATING, LATE, COUNTING)),
    ],
)
def test_the_filter_stays_consistent_and_recovers(sensors, faults):
    """As with readings of one instant: NEES from 30 s on, and error after the last fault."""
    _, seen = flown(sensors, decisions=240, horizon=240.0, **(ALL if faults == "all" else HARD[faults]))
    print(f"NEES {seen['nees'][30:].mean():.2f}")
    assert 0.1 < seen["nees"][30:].mean() < 2.0
    assert seen["nees"][160:].mean() < 2.0
    assert np.quantile(seen["relative_error"][160], 0.9) < 0.01


@pytest.mark.compiled
def test_without_gate_a_stuck_encoder_leaves_a_certain_filter_wrong():
    flights = [flown(COUNTING, estimator, tachometer_stuck=1.0)[1] for estimator in ("momentum", GATE)]
    ungated, gated = (flight["nees"][60:].mean() for flight in flights)
    print(f"NEES {ungated:.0f} without a gate")
    assert ungated > 100.0 * gated


@pytest.mark.compiled
def test_a_step_of_inertia_is_not_taken_for_a_stuck_encoder():
    law = {"mode": "step", "size": 0.1, "time": 60.0}
    envs, seen = flown(COUNTING, {**GATE, "adaptive": True}, law, decisions=90)
    assert seen["nees"][70:].mean() < 2.0
    assert np.mean(envs.fleet.rows.beliefs["adaptation"]["steps"] == 1) > 0.8


@pytest.mark.compiled
def test_a_gate_that_rejects_nothing_changes_nothing():
    flights = [flown(INTEGRATING, estimator, decisions=30, count=4)[1]["mean"] for estimator in ("momentum", GATE)]
    np.testing.assert_array_equal(*flights)


@pytest.mark.compiled
@cases("share", [0.0, 0.02, 1.0])
def test_a_count_that_repeats_is_stuck_once_commands_should_have_changed_it(share):
    """By two pulses, and what a sample's torque at its limit does: not without command, later with a gentle one."""
    ekf, quantum, wheels = encoder_filter()
    torque = share * wheels.max_torque
    change = torque[0] * 0.1 / wheels.inertia[0]
    slack = 2.0 * quantum + 0.1 * wheels.max_torque[0] / wheels.inertia[0]
    stuck = []
    for _ in range(40):
        ekf.command(torque)
        ekf.predict(np.full(3, 20.0 * quantum), 0.1)
        stuck.append(bool(ekf.record["stuck"][0] == 1))
    first = np.ceil(slack / change) if share else 41
    assert stuck == [k >= first for k in range(1, 41)]
    speed = 20.0 * quantum + 40.0 * change
    np.testing.assert_allclose(ekf.accepted[1], speed if stuck[-1] else 20.0 * quantum, rtol=1e-9)
