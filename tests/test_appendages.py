"""Appendages of a scenario: the data sheets it draws, what it refuses, and environments that fly them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.stats import kstest

from satid_gym import SATELLITES, Pilot, SatInertiaIDEnv, SatInertiaIDVectorEnv, Scenario
from satid_gym.appendages import Panels, Tank
from satid_gym.drawn_satellite import draw_satellites
from satid_gym.modes import Mode, mode_of
from satid_gym.policies.shaped_square import ShapedSquarePolicy
from satid_gym.problem import problem
from satid_gym.satellite import BENCHMARK_SATELLITES
from satid_gym.scenario_catalogue import SCENARIOS
from tests.cases import cases

FLEX, SLOSH = SCENARIOS["flex"].appendages, SCENARIOS["slosh"].appendages
# each number of oscillators compiles the kernels again
FLOWN = pytest.mark.parametrize("name", ["flex", pytest.param("slosh", marks=pytest.mark.slow)])
RANGES = {"share": (0.02, 0.2), "frequency": (0.1, 1.0), "damping": (0.001, 0.01)}


def shares(appendages, satellite) -> list[float]:
    """d^2 / J of panels about their hinges, mass over that of the satellite of a tank."""
    found = []
    for (o,) in (sheet.oscillators for sheet in appendages.equip(satellite)):
        d = mode_of(o, satellite.mass).coupling
        of_axis = d**2 / np.diag(satellite.inertia)
        assert isinstance(appendages, Tank) or np.count_nonzero(of_axis) == 1
        found.append(o.mass / satellite.mass if isinstance(appendages, Tank) else float(of_axis.max()))
    return found


@cases("name", ["flex", "slosh"])
@cases("satellite", BENCHMARK_SATELLITES)
def test_sheets_are_drawn_log_uniformly_within_their_ranges(name, satellite):
    appendages = SCENARIOS[name].appendages.replace(sheets=300)
    body = SATELLITES[satellite]
    oscillators = [sheet.oscillators[0] for sheet in appendages.equip(body)]
    drawn = {
        "share": shares(appendages, body),
        "frequency": [o.frequency for o in oscillators],
        "damping": [o.damping for o in oscillators],
    }
    for what, values in drawn.items():
        low, high = np.log(getattr(appendages, what))
        assert kstest((np.log(values) - low) / (high - low), "uniform").pvalue > 1e-3, what
    for o in oscillators:
        assert (o.mass_std, o.frequency_std, o.damping_std) == (0.2, 0.3, 0.3)
        assert o.deflection_limit == appendages.deflection_limit
    if name == "slosh":
        size = float(np.mean(body.size))
        arms = np.array([np.linalg.norm(o.position) for o in oscillators]) / size
        assert 0.25 <= arms.min() < 0.26
        assert 0.49 < arms.max() <= 0.5
        assert all(abs(o.position @ o.direction) < 1e-12 * size for o in oscillators), "it moves across the way to it"
    else:
        axes = {(int(np.argmax(o.arm)), int(np.argmax(o.axis))) for o in oscillators}
        assert len(axes) == 6, "each pair of two axes comes up"


def test_same_seed_same_sheets():
    body = SATELLITES["microsat"]
    for appendages in (FLEX, SLOSH):
        few, same, other = (
            a.equip(body) for a in (appendages.replace(sheets=3), appendages, appendages.replace(seed=1))
        )
        assert same == appendages.equip(body)
        assert few == same[:3], "more sheets leave the first ones as they are"
        assert not set(same) & set(other)


def test_a_sheet_that_a_satellite_cannot_carry_is_drawn_again():
    """Panels of a fifth of each moment fit two axes of a long box, not the third; the others keep their first draw."""
    (light,) = draw_satellites([2_000_000_002], wheels=4)
    first = [np.random.default_rng([FLEX.seed, i]) for i in range(FLEX.sheets)]
    kept = 0
    for own, sheet in zip((FLEX.draw(light, rng) for rng in first), FLEX.equip(light), strict=True):
        try:
            assert light.replace(oscillators=(own,)) == sheet
            kept += 1
        except ValueError:
            assert sheet.oscillators != (own,)
    assert FLEX.sheets / 2 < kept < FLEX.sheets
    assert 0.02 < min(shares(FLEX, light)) <= max(shares(FLEX, light)) < 0.25
    with pytest.raises(ValueError, match=r"can carry none of 1000 data sheets .* a smaller share; of the last one, "):
        FLEX.replace(share=(0.4, 0.5)).equip(light.replace(mass=1e-3 * light.mass))


@cases(
    ("change", "message"),
    [
        ({"share": (0.2, 0.1)}, "share of the appendages must be"),
        ({"share": (0.1, 0.6)}, "share of the appendages must be"),
        ({"frequency": (0.0, 1.0)}, "frequency of the appendages must be"),
        ({"damping": (0.1, 0.9)}, "damping of the appendages must be"),
        ({"mass_std": -0.1}, "mass_std of the appendages must be"),
        ({"mass_std": 0.6}, "mass_std of the appendages must be"),
        ({"frequency_std": 2.0}, "frequency_std of the appendages must be"),
        ({"damping_std": -1e-9}, "damping_std of the appendages must be"),
        ({"deflection_limit": 0.0}, "deflection_limit of the appendages must be"),
        ({"sheets": 0}, "sheets of the appendages must be"),
        ({"seed": -1}, "seed of the appendages must be"),
    ],
)
def test_bad_ranges_are_refused(change, message):
    for kind in (Panels, Tank):
        with pytest.raises(ValueError, match=message):
            kind(**{**RANGES, **change})


@cases(
    ("change", "message"),
    [
        ({"frequency": -1.0}, "mode frequency must be"),
        ({"frequency": 0.0}, "mode frequency must be"),
        ({"damping": 9.0}, "mode damping must be"),
        ({"damping": -0.1}, "mode damping must be"),
        ({"deflection_limit": -1.0}, "mode deflection_limit must be"),
        ({"deflection_std": -1.0}, "mode deflection_std must be"),
        ({"coupling_std": -0.1}, "mode coupling_std must be"),
        ({"frequency_std": -0.1}, "mode frequency_std must be"),
        ({"damping_std": -0.1}, "mode damping_std must be"),
    ],
)
def test_a_mode_that_is_none_is_refused(change, message):
    settings = {"coupling": [0.0, 0.0, 0.5], "frequency": 0.3, "damping": 0.01}
    assert Mode(**settings).deflection_limit is None
    with pytest.raises(ValueError, match=message):
        Mode(**{**settings, **change})


@cases("name", ["flex", "slosh"])
def test_a_scenario_with_appendages_goes_through_json(name):
    own = SCENARIOS[name]
    back = Scenario.from_dict(json.loads(json.dumps(own.to_dict())))
    assert back == own
    assert type(back.appendages) is type(own.appendages)
    assert back.appendages.equip(SATELLITES["cubesat"]) == own.appendages.equip(SATELLITES["cubesat"])


@cases("name", ["flex", "slosh"])
@cases("satellite", BENCHMARK_SATELLITES)
def test_all_satellites_can_carry_them(name, satellite):
    """Every sheet is one that the environment takes: sampled fast enough, with inertia left to the body."""
    found = problem(satellite, "static", name)
    assert len(found.satellites) == 32
    assert len(set(found.satellites)) == 32


def test_satellites_with_oscillators_of_their_own_are_refused():
    flexible, sloshing = (SCENARIOS[name].appendages.equip(SATELLITES["microsat"])[0] for name in ("flex", "slosh"))
    for scenario, satellite in (("flex", sloshing), ("slosh", flexible)):
        with pytest.raises(ValueError, match="has oscillators of its own"):
            problem(satellite, "static", scenario)
    assert problem(flexible, "static", "flex").satellites == (flexible,), "one of its own sheets stays as it is"


@FLOWN
def test_single_and_vector_fly_the_same_sheet(name):
    single = SatInertiaIDEnv("microsat", "static", name, observation="body")
    many = SatInertiaIDVectorEnv(3, "microsat", "static", name, observation="body")
    (both, _), rng = many.reset(seed=[5, 6, 7]), np.random.default_rng(0)
    one, _ = single.reset(seed=6)
    for _ in range(5):
        np.testing.assert_array_equal(one, both[1])
        action = rng.uniform(-0.3, 0.3, (3, 3)).astype(np.float32)
        one, both = single.step(action[1])[0], many.step(action)[0]
    frequencies = many.fleet.rows.beliefs["modes"]["frequency"][:, 0]
    assert len(set(frequencies)) > 1, "each episode draws its own"


@FLOWN
def test_a_sheet_may_be_given_at_reset(name):
    env = SatInertiaIDEnv("microsat", "static", name)
    for i in (3, 17):
        sheet = env.problem.satellites[i]
        env.reset(seed=0, options={"satellite": sheet})
        (mode,) = sheet.modes
        own = env.fleet.rows.beliefs["modes"][0]
        assert own["frequency"][0] == pytest.approx(2.0 * np.pi * mode.frequency)
        np.testing.assert_allclose(own["coupling"][0], mode.coupling)
        np.testing.assert_array_equal(
            env.fleet.rows.tasks["deflection_limit"][0], sheet.oscillators[0].deflection_limit
        )
    other = SCENARIOS[name].appendages.replace(seed=9).equip(SATELLITES["microsat"])[0]
    with pytest.raises(ValueError, match="has oscillators of its own"):
        env.reset(options={"satellite": other})


def test_a_pilot_flies_one_of_the_data_sheets():
    with pytest.raises(ValueError, match=r"in scenario 'flex' stands for 32: give one .*problem\.satellites"):
        Pilot("microsat", ShapedSquarePolicy(), scenario="flex", control="rate")
    sheet = problem("microsat", scenario="flex").satellites[3]
    pilot = Pilot(sheet, ShapedSquarePolicy(), scenario="flex", control="rate")
    assert pilot.mission.satellite.oscillators == sheet.oscillators
