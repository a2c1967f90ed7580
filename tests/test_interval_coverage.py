"""The short form of `python -m tests.interval_coverage`."""

import numpy as np
import pytest
from scipy.stats import binom

from satid_gym.metrics import iqm
from tests.interval_coverage import LEAST, MOST, SYNTHETIC, misses

SIMULATIONS = 60


@pytest.mark.parametrize("name", [name for name, population in SYNTHETIC.items() if population.judged])
def test_intervals_cover_what_they_are_about(name):
    # fewer than 5 in a million runs leave these limits where the coverage keeps 93 to 97 %
    least, most = binom.ppf(5e-6, SIMULATIONS, LEAST), binom.ppf(1 - 5e-6, SIMULATIONS, MOST)
    for statistic, (above, below) in misses(SYNTHETIC[name], 100, SIMULATIONS, seed=3).items():
        assert least <= SIMULATIONS - above - below <= most, statistic


@pytest.mark.parametrize("name", SYNTHETIC)
def test_the_truth_is_that_of_the_population(name):
    population = SYNTHETIC[name]
    mine, theirs = population.draw(np.random.default_rng(0), 400_000)
    assert mine.mean() == pytest.approx(population.truth["final_error"], rel=0.03)
    assert iqm(mine) == pytest.approx(population.truth["final_error_iqm"], rel=0.01)
    assert (mine - theirs).mean() == pytest.approx(population.truth["difference"], rel=0.05, abs=0.005)
    assert (mine < theirs).mean() == pytest.approx(population.truth["probability_of_improvement"], abs=0.003)
