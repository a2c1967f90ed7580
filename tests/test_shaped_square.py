"""Square waves that spare the modes: against an oscillator that scipy moves, and what they refuse."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from satid_gym import SATELLITES, SloshMass
from satid_gym.core.observation import MODE_PARTS
from satid_gym.policies.shaped_square import ShapedSquarePolicy
from satid_gym.policy import Mission, missions
from satid_gym.problem import problem
from tests.cases import cases

TANK = SloshMass(
    mass=3.0, position=[0.0, 0.3, 0.0], direction=[0.6, 0.0, 0.8], frequency=0.1, damping=0.0, deflection_limit=0.02
)
SLOSHING = SATELLITES["microsat"].replace(name="sloshing", oscillators=[TANK])
SETTINGS = {"control": "rate", "observation": "body"}
J = np.array([7.5, 6.0, 3.6])  # kg m^2, as the filter believes it in these tests
EXACT = -10.0  # as the std of what is known exactly is observed


def mission(**settings) -> Mission:
    return missions(problem(SLOSHING, "static", **{**SETTINGS, **settings}))[0]


class Oscillator:
    """One mode whose body turns as commanded, nothing damped: eta'' + w^2 eta = omega . K omega - d . omega'.

    `pull` is K as (xx, yy, zz, xy, xz, yz).
    """

    def __init__(self, frequency: float, d: np.ndarray, limit: float, pull: Sequence[float] = (0.0,) * 6) -> None:
        self.w, self.d, self.limit, self.pull = 2.0 * np.pi * frequency, d, limit, np.array(pull)
        self.state, self.omega, self.peak = np.zeros(2), np.zeros(3), 0.0

    def turn(self, omega: np.ndarray, duration: float) -> None:
        """Bring the body to a rate, rad/s, by a constant acceleration."""
        before, change = self.omega, omega - self.omega
        xx, yy, zz, xy, xz, yz = self.pull
        K = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

        def push(t: float) -> float:
            now = before + change * t / duration
            return float(now @ K @ now - self.d @ change / duration)

        times = np.linspace(0.0, duration, 101)
        found = solve_ivp(
            lambda t, y: [y[1], push(t) - self.w**2 * y[0]], (0.0, duration), self.state, t_eval=times, rtol=1e-9,
            atol=1e-12,
        ).y  # fmt: skip
        self.state, self.omega = found[:, -1], omega
        self.peak = max(self.peak, np.abs(found[0]).max())


def seen(own: Mission, mode: Oscillator, sheet: Oscillator, begins: bool = False) -> np.ndarray:
    """Observation (1, size) of the mode, by the definitions of `satid_gym.env`."""
    observation = np.zeros((1, max(place.stop for place in own.layout.values())))
    observation[0, own.layout["time_left"]] = 1.0 if begins else 0.9
    observation[0, own.layout["inertia"]] = J / np.diag(own.prior.inertia) - 1.0
    rung = np.linalg.norm(sheet.d) * own.satellite.rate_limit
    parts = {
        "deflection": mode.state[0] * sheet.w / rung,
        "deflection_rate": mode.state[1] / rung,
        "deflection_limit": mode.limit * sheet.w / rung,
        "frequency": mode.w / (2.0 * np.pi) * own.scenario.decision_period,
        "frequency_std": EXACT,
        "coupling": mode.d / np.sqrt(J),
        "coupling_std": EXACT,
        "damping": EXACT,
        "damping_std": EXACT,
        "centrifugal": mode.pull * own.satellite.rate_limit * sheet.w / (np.linalg.norm(sheet.d) * mode.w**2),
    }
    assert list(parts) == list(MODE_PARTS)
    observation[0, own.layout["modes"]] = np.concatenate([np.atleast_1d(value) for value in parts.values()])
    return observation


def sheet_and_truth(frequency: float) -> tuple[Oscillator, Oscillator]:
    """A data sheet, and a mode that is heavier and slower, with a limit of eta that goes with the root of its mass."""
    d = np.array([0.3, 0.0, 0.4])
    return Oscillator(frequency, d, 0.02), Oscillator(0.8 * frequency, 1.2 * d, 1.2 * 0.02)


def policy(own: Mission, sheet: Oscillator, **settings) -> ShapedSquarePolicy:
    """That commands all of the rate limit, for its margin is none, and has read the data sheet."""
    found = ShapedSquarePolicy(caution=0.0, margin=0.0, **settings)
    found.reset(own, [0])
    found._modes.read(seen(own, sheet, sheet, begins=True))
    return found


@cases("frequency", [0.1, 0.25, 0.6])
@cases("share", [0.3, 0.8])
def test_a_change_of_rate_bends_a_mode_at_rest_to_its_share_of_the_limit(frequency, share):
    """|eta_0| + A = 2 |d| domega / (T w^2) in a mode that is at rest: twice what it bends under a steady push."""
    own = mission()
    sheet, mode = sheet_and_truth(frequency)
    square = policy(own, sheet, share=share)
    rate = own.satellite.rate_limit * square(seen(own, mode, sheet))[0]
    changed = abs(rate @ mode.d) / np.linalg.norm(mode.d)
    allowed = 0.5 * share * mode.limit * mode.w**2 * own.scenario.decision_period / np.linalg.norm(mode.d)
    wanted = own.satellite.rate_limit * abs(np.array([1.0, 1.0, -1.0]) @ mode.d) / np.linalg.norm(mode.d)
    assert changed == pytest.approx(min(allowed, wanted), rel=1e-6)
    mode.turn(rate, own.scenario.decision_period)
    mode.turn(rate, 2.0 / frequency)  # it rings on, and no further
    assert mode.peak <= share * mode.limit * (1.0 + 1e-6)


@cases("frequency", [0.06, 0.1, 0.25])
def test_a_flight_uses_the_share_and_stays_within(frequency):
    own = mission()
    sheet, mode = sheet_and_truth(frequency)
    square = policy(own, sheet, share=0.7, period=24.0)
    rates = []
    for _ in range(150):
        rates.append(square(seen(own, mode, sheet))[0])
        mode.turn(own.satellite.rate_limit * rates[-1], own.scenario.decision_period)
    assert 0.6 * mode.limit < mode.peak <= 0.7 * mode.limit * (1.0 + 1e-6)
    along = np.array(rates) @ mode.d / np.linalg.norm(mode.d)
    assert np.ptp(along) > 1.5, "it turns to and fro all the same"


@cases("share", [0.6, 0.9])
def test_a_rotation_that_pulls_a_panel_leaves_less_room(share):
    """Along x, hinged about z: full rates about x and y pull it to a third of what is allowed, where it rests."""
    own, w, d = mission(), 2.0 * np.pi * 0.1, np.array([0.0, 0.0, 0.4])
    pulled, rate_limit = 0.02 * share / 3.0, own.satellite.rate_limit
    mode = Oscillator(0.1, d, 0.02, [0.0, 0.0, 0.0, 0.5 * pulled * (w / rate_limit) ** 2, 0.0, 0.0])
    square = policy(own, mode, share=share)
    mode.state, mode.omega = np.array([pulled, 0.0]), rate_limit * np.array([1.0, 1.0, 0.0])
    rate = rate_limit * square(seen(own, mode, mode))[0]
    np.testing.assert_allclose(rate[:2], rate_limit)
    assert abs(rate[2]) == pytest.approx(
        0.5 * (share * mode.limit - pulled) * w**2 * own.scenario.decision_period / 0.4
    )
    mode.turn(rate, own.scenario.decision_period)
    mode.turn(rate, 20.0)
    assert 1.1 * pulled < mode.peak <= share * mode.limit * (1.0 + 1e-6)


def test_a_mode_that_rings_is_damped():
    own = mission()
    sheet, mode = sheet_and_truth(0.1)
    square = policy(own, sheet, share=0.3)
    mode.state = np.array([2.0 * mode.limit, 0.0])
    for _ in range(60):
        mode.turn(own.satellite.rate_limit * square(seen(own, mode, sheet))[0], own.scenario.decision_period)
    assert np.hypot(mode.state[0], mode.state[1] / mode.w) < 0.5 * mode.limit


@cases("limit", [10.0, 0.0])
def test_without_a_limit_it_reverses_at_once(limit):
    """10 is observed without a limit, 0 where no rotation excites the mode."""
    own = mission()
    sheet, _ = sheet_and_truth(0.002)  # so slow that a limit of 10 would hold it
    observation = seen(own, sheet, sheet)
    observation[0, own.layout["modes"].start + list(MODE_PARTS).index("deflection_limit")] = limit
    np.testing.assert_allclose(policy(own, sheet)(observation)[0], [1.0, 1.0, -1.0], atol=1e-12)


def test_what_it_cannot_fly_is_refused():
    square = ShapedSquarePolicy()
    with pytest.raises(ValueError, match="shaped_square commands body rates"):
        square.reset(mission(control="torque"), [0])
    with pytest.raises(ValueError, match=r"and observation 'wheels'"):
        square.reset(mission(observation="wheels"), [0])
    with pytest.raises(ValueError, match=r"the filter estimates no modes, so those of 'sloshing'"):
        square.reset(mission(estimator={"name": "momentum", "flexible": False}), [0])
    square.reset(missions(problem("microsat", "static", **SETTINGS))[0], [0])  # rigid: it has none to spare
    for settings in ({"share": 1.2}, {"share": 0.0}, {"amplitude": 1.1}, {"period": 0.0}, {"caution": -1.0}):
        with pytest.raises(ValueError, match=next(iter(settings))):
            ShapedSquarePolicy(**settings)
