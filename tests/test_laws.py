"""The inertia laws: the paper's numbers, the training ranges, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from satid_gym import InertiaLaw, LawRanges, paper_law
from satid_gym.law_ranges import PAPER_LAWS
from satid_gym.laws import MASS_MODES
from tests.cases import cases


@cases(
    ("mode", "size", "time", "frequency"),
    [
        ("static", 0.0, 150.0, 0.0),
        ("step", 0.1, 60.0, 0.0),
        ("drift", 0.05, 120.0, 0.0),
        ("periodic", 0.03, 150.0, 0.02),
    ],
)
def test_paper_laws_over_two_minutes(mode, size, time, frequency):
    """Section IV of the paper: 10 % at half time, 5 % over all of it, 3 % at 0.02 Hz."""
    law = paper_law(mode, 120.0)
    assert (law.mode, law.size, law.frequency, law.phase) == (mode, size, frequency, 0.0)
    assert law.time == time
    assert law.change is None
    assert paper_law("drift").time == 300.0


def test_ranges_of_the_paper_are_its_numbers():
    paper = PAPER_LAWS.to_dict()
    masses = {name for name in paper if name.split("_")[0] in MASS_MODES}  # which the paper has not
    assert {name: tuple(own) for name, own in paper.items() if name not in masses} == {
        "step_size": (0.1, 0.1),
        "step_time": (0.5, 0.5),
        "drift_size": (0.05, 0.05),
        "periodic_size": (0.03, 0.03),
        "frequency": (0.02, 0.02),
        "phase": (0.0, 0.0),
    }


def test_training_ranges_hold_the_papers_laws():
    """The randomised laws scatter about those of the paper, whose numbers are in the middle of each range."""
    ranges = LawRanges()
    for name in ("step_size", "step_time", "drift_size"):
        assert np.mean(getattr(ranges, name)) == pytest.approx(getattr(PAPER_LAWS, name)[0])
    assert np.mean(ranges.periodic_size) == pytest.approx(0.03)
    assert np.mean(ranges.frequency) == pytest.approx(0.02)
    assert ranges.phase == (0.0, 2.0 * np.pi)
    widths = [np.ptp(getattr(ranges, name)) for name in ("step_size", "step_time", "drift_size", "periodic_size")]
    np.testing.assert_allclose(widths, [0.1, 0.4, 0.06, 0.04])
    assert np.ptp(ranges.frequency) == pytest.approx(0.02)


BOUNDS = {
    "step_size": (-0.9, 10.0),
    "step_time": (0.0, 1.0),
    "drift_size": (-0.9, 10.0),
    "periodic_size": (0.0, 0.9),
    "frequency": (0.0, 10.0),
    "phase": (-100.0, 100.0),
    "deployment_size": (0.0, 100.0),
    "deployment_time": (0.0, 1.0),
    "deployment_duration": (0.1, 1e6),
    "fuel_size": (0.0, 1.0),
    "release_size": (0.0, 1.0),
    "release_time": (0.0, 1.0),
}


@cases("name", BOUNDS)
def test_a_range_may_reach_its_bounds_and_not_pass_them(name):
    least, most = BOUNDS[name]
    assert getattr(LawRanges(**{name: [least, most]}), name) == (least, most)
    middle = 0.5 * (least + most)
    assert getattr(LawRanges(**{name: (middle, middle)}), name) == (middle, middle)
    for wrong in ((np.nextafter(least, -np.inf), most), (least, np.nextafter(most, np.inf)), (middle, least)):
        with pytest.raises(ValueError, match=rf"{name} of the law ranges must be .low, high. with {least} <= low"):
            LawRanges(**{name: wrong})
    with pytest.raises(ValueError, match=rf"{name} of the law ranges must have shape .2,."):
        LawRanges(**{name: (middle,)})


def test_moments_are_the_diagonal_of_a_change():
    np.testing.assert_array_equal(InertiaLaw("step", change=(1.0, 2.0, 3.0)).change, np.diag([1.0, 2.0, 3.0]))
    tensor = np.array([[1.0, 0.5, 0.0], [0.5, 2.0, 0.1], [0.0, 0.1, 3.0]])
    np.testing.assert_array_equal(InertiaLaw("step", change=tensor).change, tensor)


def test_limits_of_a_law():
    """At the edge of what is allowed: a change by just less than all, a step at once, a phase before zero."""
    assert InertiaLaw("step", size=-0.999, time=0.0).size == -0.999
    assert InertiaLaw("periodic", phase=-3.0, frequency=1e-6).phase == -3.0
    assert InertiaLaw("step", frequency=0.0).frequency == 0.0
    with pytest.raises(ValueError, match=r"mode \"periodic\" needs a frequency above 0 Hz, got 0"):
        InertiaLaw("periodic", size=0.1)
    assert InertiaLaw("drift").time == 150.0
    with pytest.raises(ValueError, match="unknown mode"):
        InertiaLaw("wobble")
    with pytest.raises(ValueError, match="size of the inertia law"):
        InertiaLaw("step", size=-1.0)
    with pytest.raises(ValueError, match="change of the inertia law must have shape"):
        InertiaLaw("step", change=(1.0, 2.0))
