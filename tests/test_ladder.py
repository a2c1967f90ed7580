"""The ladder: its family is energy-matched, its information is Fisher's, its verdicts on a small climb."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.studies import observability
from baselines.studies.recording import record
from satid_gym import SATELLITES
from satid_gym.evaluation import seeds
from satid_gym.policy import missions
from satid_gym.problem import problem
from satid_gym.scenario import prior_of


def test_family_has_one_energy() -> None:
    assert len(observability.FAMILY) >= 14
    (mission,) = missions(problem("microsat", "static", observability.IDEAL))
    powers = []
    for name in observability.FAMILY:
        policy = observability.matched(name, 0.02, observability.IDEAL)
        policy.reset(mission, [0])
        script = np.array([policy(np.zeros((1, 1)))[0] for _ in range(300)])
        assert np.abs(script).max() < 1.0  # no limit has cut it
        powers.append(np.mean(script**2))
    np.testing.assert_allclose(powers, 0.02**2, rtol=1e-12)


def test_information_is_that_of_the_rates_where_the_momentum_is_known() -> None:
    """Between sum omega^2 / variance on each axis, of a known momentum, and the same about the mean rate."""
    satellite = SATELLITES["microsat"]
    world = observability.IDEAL.replace(inertia_std=0.0, wheel_speed_range=0.0, initial_rate_std=0.0)
    policy = observability.matched("staggered_84s", 0.02, world)
    flight = record(policy, satellite="microsat", inertia="static", seeds=[0], scenario=world)
    prior = prior_of(satellite, world.replace(gyro_noise_std=None, tachometer_noise_std=None))
    found = observability.information(flight, prior)["logdet"]
    moments = np.diag(satellite.inertia)
    variance = (5e-5 * moments) ** 2 + (2e-3 * 0.05) ** 2
    centred = flight.motion.rate[0] - flight.motion.rate[0].mean(axis=0)
    known = np.log(np.square(flight.motion.rate[0]).sum(axis=0) * moments**2 / variance).sum()
    unknown = np.log(np.square(centred).sum(axis=0) * moments**2 / variance).sum()
    assert unknown - 0.1 < found < known + 0.1


def test_rank_correlation_by_hand() -> None:
    names = [*observability.ESTIMATORS, "held"]
    records = [
        {"world": "w", "logdet": x, **dict.fromkeys(names, -x), "ls": 1.0, "iv": x, "held": y}
        for x, y in ((1.0, 3.0), (2.0, 1.0), (3.0, 2.0))
    ]
    (row,) = observability.correlations(records)
    assert row["ls"] is None  # it refused everything
    assert row["iv"] == pytest.approx(1.0)
    assert row["momentum_ekf"] == pytest.approx(-1.0)
    assert row["held"] == pytest.approx(0.5)  # ranks 3 1 2 against 3 2 1: 1 - 6 (0 + 1 + 1) / 24


@pytest.mark.slow
def test_a_small_climb(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ("one_step", "sine_3axis", "prbs", "staggered_36s", "phased_50mHz", "staggered_12s")
    monkeypatch.setattr(observability, "FAMILY", {name: observability.FAMILY[name] for name in names})
    monkeypatch.setattr(observability, "WORLDS", {name: observability.WORLDS[name] for name in ("no noise", "+ noise")})
    records = observability.run_study(observability.ObservabilityStudy(), seeds("validation", 3))
    assert [(r["world"], r["profile"]) for r in records] == [(w, n) for w in observability.WORLDS for n in names]
    table = observability.correlations(records)
    assert max(r["momentum_ls"] for r in records if r["world"] == "no noise") < 1e-4
    noisy = table[1]
    assert noisy["momentum_ekf_static"] < -0.6
    assert noisy["momentum_ls"] < -0.6
