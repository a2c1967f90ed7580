"""The random streams: the bits against the published algorithm, the deviates against their distributions."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats
from numba import njit

from satid_gym import SatInertiaIDVectorEnv
from satid_gym.core.random import between, next_word, normal, uniform
from satid_gym.gym_api import seed_stream
from tests.cases import cases

N = 1_000_000
LEVEL = 1e-3  # of every hypothesis test; the seeds are fixed, so a sound generator passes for good
MASK = 2**64 - 1


@njit
def words(stream, count):
    out = np.empty(count, np.uint64)
    for i in range(count):
        out[i] = next_word(stream)
    return out


@njit
def uniforms(stream, count):
    out = np.empty(count)
    for i in range(count):
        out[i] = uniform(stream)
    return out


@njit
def normals(stream, count):
    out = np.empty(count)
    for i in range(count):
        out[i] = normal(stream)
    return out


@njit
def between_values(stream, low, high, count):
    out = np.empty(count)
    for i in range(count):
        out[i] = between(stream, low, high)
    return out


def stream(seed: int) -> np.ndarray:
    return seed_stream(np.random.default_rng(seed))


def xoshiro256_plus_plus(state: list[int], count: int) -> list[int]:
    """Blackman and Vigna's reference (prng.di.unimi.it/xoshiro256plusplus.c), in Python's integers."""

    def rotate(x: int, k: int) -> int:
        return ((x << k) | (x >> (64 - k))) & MASK

    s, out = list(state), []
    for _ in range(count):
        out.append((rotate((s[0] + s[3]) & MASK, 23) + s[0]) & MASK)
        t = (s[1] << 17) & MASK
        s[2] ^= s[0]
        s[3] ^= s[1]
        s[1] ^= s[2]
        s[0] ^= s[3]
        s[2] ^= t
        s[3] = rotate(s[3], 45)
    return out


@cases("state", [[1, 2, 3, 4], [MASK, 1, MASK - 5, 2**63], stream(7).tolist()])
def test_bits_are_those_of_xoshiro256_plus_plus(state):
    assert words(np.array(state, np.uint64), 1000).tolist() == xoshiro256_plus_plus(state, 1000)


@pytest.mark.compiled
def test_every_bit_is_fair():
    """Share of ones in each of the 64 bits: binomial, 64 two-sided tests at once."""
    drawn = words(stream(1), 100_000)
    ones = ((drawn[:, None] >> np.arange(64, dtype=np.uint64)) & np.uint64(1)).sum(axis=0).astype(float)
    score = (ones - 50_000) / np.sqrt(25_000)
    assert np.abs(score).max() < scipy.stats.norm.isf(LEVEL / 64 / 2)


@pytest.mark.compiled
def test_uniform_is_uniform():
    x = uniforms(stream(2), N)
    assert scipy.stats.kstest(x, "uniform").pvalue > LEVEL
    counts = np.histogram(x, bins=1000, range=(0.0, 1.0))[0]
    assert scipy.stats.chisquare(counts).pvalue > LEVEL
    # pairs in a plane: neighbours do not know of each other
    pairs = np.histogram2d(x[::2], x[1::2], bins=32, range=[[0, 1], [0, 1]])[0]
    assert scipy.stats.chisquare(pairs.ravel()).pvalue > LEVEL


@cases(("state", "word"), [([0, 5, 7, MASK], MASK), ([0, 5, 7, 0], 0)])
def test_uniform_stays_inside_its_interval(state, word):
    """States made so that the next word is the largest and the smallest there is."""
    assert words(np.array(state, np.uint64), 1).tolist() == [word]
    (value,) = uniforms(np.array(state, np.uint64), 1)
    assert 0.0 < value < 1.0


@pytest.mark.compiled
def test_between_spans_its_bounds():
    x = between_values(stream(3), -2.0, 5.0, 100_000)
    assert scipy.stats.kstest(x, "uniform", args=(-2.0, 7.0)).pvalue > LEVEL


@pytest.fixture(scope="module")
def deviates() -> np.ndarray:
    return normals(stream(4), N)


@pytest.mark.compiled
def test_normal_is_normal(deviates):
    assert scipy.stats.kstest(deviates, "norm").pvalue > LEVEL
    edges = scipy.stats.norm.ppf(np.linspace(0.0, 1.0, 501))
    assert scipy.stats.chisquare(np.histogram(deviates, edges)[0]).pvalue > LEVEL


@pytest.mark.compiled
def test_moments_of_normal(deviates):
    """The first four, each within its standard error."""
    moments = [deviates.mean(), deviates.var() - 1.0, (deviates**3).mean(), (deviates**4).mean() - 3.0]
    errors = np.sqrt(np.array([1.0, 2.0, 15.0, 96.0]) / N)  # variances of x, x^2, x^3, x^4
    assert np.all(np.abs(moments) < scipy.stats.norm.isf(LEVEL / 8) * errors)


@pytest.mark.compiled
def test_tails_of_normal(deviates):
    """Beyond 3.4426 another part of the ziggurat's code draws: how often, how far, and on which side."""
    edge = 3.442619855899
    tail = deviates[np.abs(deviates) > edge]
    share = 2.0 * scipy.stats.norm.sf(edge)
    assert scipy.stats.binomtest(len(tail), N, share).pvalue > LEVEL
    assert scipy.stats.binomtest(int((tail > 0).sum()), len(tail)).pvalue > LEVEL
    depth = scipy.stats.norm.sf(np.abs(tail)) / scipy.stats.norm.sf(edge)
    assert scipy.stats.kstest(depth, "uniform").pvalue > LEVEL


@pytest.mark.compiled
def test_normal_deviates_are_independent(deviates):
    """Correlation at the first lags, of values and of squares."""
    for series in (deviates, deviates**2 - 1.0):
        scale = np.mean(series**2)
        lags = np.array([np.mean(series[lag:] * series[:-lag]) / scale for lag in range(1, 21)])
        assert np.abs(lags).max() * np.sqrt(N) < scipy.stats.norm.isf(LEVEL / 20 / 2)


@pytest.mark.compiled
def test_streams_of_neighbouring_seeds_are_independent():
    count = 100_000
    drawn = np.array([normals(stream(seed), count) for seed in range(8)])
    correlation = np.corrcoef(drawn)[np.triu_indices(8, 1)]
    assert np.abs(correlation).max() * np.sqrt(count) < scipy.stats.norm.isf(LEVEL / 28 / 2)
    heads = np.concatenate([words(stream(seed), 1000) for seed in range(200)])
    assert len(np.unique(heads)) == len(heads), "no stream meets another"


@pytest.mark.compiled
def test_environments_draw_from_different_streams():
    """First gyro readings of 2000 seeds, whitened by what they are made of, look like one normal sample."""
    env = SatInertiaIDVectorEnv(2000, scenario={"initial_rate_std": 0.0, "disturbance_scale": 0.0})
    observation, _ = env.reset(seed=0)
    scenario, satellite = env.problem.scenario, env.problem.satellites[0]
    assert scenario.gyro_noise_std is None
    readings = observation[:, :3].astype(float) * satellite.rate_limit / satellite.gyro_noise_std
    assert scipy.stats.kstest(readings.ravel(), "norm").pvalue > LEVEL
    lag = np.mean(readings[1:] * readings[:-1])
    assert abs(lag) * np.sqrt(readings[1:].size) < scipy.stats.norm.isf(LEVEL / 2)
