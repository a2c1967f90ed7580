"""Star tracker: what truth reads, when it is blind, and how the filter estimates the attitude beside the inertia."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.studies.recording import record
from satid_gym import SATELLITES, SatInertiaIDEnv, Scenario, Sensors, StarTracker
from satid_gym.core import kernels
from satid_gym.estimators import FilterpyMomentumEKF, MomentumEKF
from satid_gym.policies.registry import make_baseline
from satid_gym.policy import missions
from satid_gym.problem import problem
from tests.cases import cases

TRACKER = StarTracker(boresight=[0.6, 0.0, 0.8], period=0.5)
BIAS = {"gyro_bias": 1e-4}  # all tests have one state size, for each has a filter to compile


def world(tracker=TRACKER, **settings):
    return Scenario(**{"tolerances": BIAS, "sensors": Sensors(star_tracker=tracker), "horizon": 60.0, **settings})


@pytest.fixture(scope="module")
def flown():
    """Readings of a flight, and the prior of its filter."""
    settings = {"satellite": "microsat", "inertia": "drift", "scenario": world()}
    policy = make_baseline("rate_square", "microsat")
    recording = record(policy, seeds=[90_001], estimator="momentum", **settings)
    (mission,) = missions(problem(**settings))
    return recording, mission.prior


# belief


@pytest.mark.compiled
def test_compiled_equals_filterpy(flown):
    recording, prior = flown
    fast, slow = MomentumEKF(), FilterpyMomentumEKF()
    known = 0
    for k in range(recording.gyro.shape[1]):
        gyro, speed, attitude = recording.gyro[0, k], recording.tachometer[0, k], recording.star_tracker[0, k]
        for estimator in (fast, slow):
            if k == 0:
                estimator.reset(prior, gyro, speed)
            else:
                estimator.predict(speed, recording.dt)
        if k > 0:
            assert fast.update(gyro, speed) == pytest.approx(slow.update(gyro, speed), rel=1e-6, abs=1e-9)
        if np.isfinite(attitude).all():
            nis = fast.update_attitude(attitude)
            assert 3.0 * nis == pytest.approx(3.0 * slow.update_attitude(attitude), rel=1e-6, abs=1e-9)
            known += nis > 0.0
        std = np.sqrt(np.diag(slow.covariance)) + 1e-300
        np.testing.assert_allclose(fast.mean / std, slow.mean / std, rtol=1e-9, atol=1e-7)
        np.testing.assert_allclose(
            fast.covariance / np.outer(std, std), slow.covariance / np.outer(std, std), atol=1e-7
        )
    assert known > 80
