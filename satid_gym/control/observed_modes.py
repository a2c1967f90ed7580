"""Panels and tanks as observed, and how far they will bend under commands of the body rate.

A mode that is excited by an acceleration a of the body swings about eta_0 = -d . a / w^2, a circle of the point
(eta, deta/dt / w). Rates are foreseen as a first-order lag, as quick as the wheels' torque allows each axis. w is the
filter's estimate less some of its standard deviations, for a slower mode bends further. Damping, which is small, is
left out, and so is the pull of the rotation: in a tour it changes sign before a slow tank has followed. Panels do
follow it, and are spared by `mode_shaping`, which also has the units of what is observed of a mode.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from satid_gym.config import check_number
from satid_gym.core.algebra import dot, load, multiply
from satid_gym.core.jit import inline, kernel, outline
from satid_gym.core.observation import BOUND, MODE_PARTS, MODE_PLACES, observed_std
from satid_gym.policy import Mission

_READ = ("rate", "control_authority", "inertia", "modes", "time_left")  # parts of the observation
TINY = 1e-12  # of a length, so that none is divided by 0
_AHEAD = 8  # decisions in which rates settle
STEPS = 4  # of a decision, in which accelerations are taken to be constant


def step_lag(turns: float) -> float:
    """Share of a commanded change that the rate loop brings in a step; `turns` is its bandwidth times a decision."""
    return float(1.0 - np.exp(-turns / STEPS))


class Modes(NamedTuple):
    """Belief about the modes of N episodes, and what moves them.

    Attributes:
        rate: (N, 3) of the body over its limit.
        most: (N, 3) change of it in a step that the wheels have torque for.
        swing: (N, modes, 2) deflection, and its rate over w.
        direction: (N, modes, 3) unit vector of d.
        bent: (N, modes) eta_0 by change of the rate along d in a decision.
        turn: (N, modes, 2) cosine and sine of w times a step.
        turned: (N, modes) w times a decision.
        limit: (N, modes) share of the limit of deflection; infinite without one.
        pull: (N, modes, 6) of the rotation: (xx, yy, zz, xy, xz, yz) of K, where rates r over the limit that stay
            pull a mode to r . K r.
    """

    rate: np.ndarray
    most: np.ndarray
    swing: np.ndarray
    direction: np.ndarray
    bent: np.ndarray
    turn: np.ndarray
    turned: np.ndarray
    limit: np.ndarray
    pull: np.ndarray

    def pulled(self, rates: np.ndarray) -> np.ndarray:
        """Deflection (N, K, modes) to which the rotation pulls the modes at rates (N, K, 3) over the limit."""
        pulled = np.empty((*rates.shape[:2], self.pull.shape[1]))
        pulled_many(self, np.array(rates, order="C"), pulled)  # writable: one kernel for all
        return pulled

    def of(self, rows: np.ndarray) -> Modes:
        """Modes of some episodes."""
        return Modes(*(part[rows] for part in self))


class ObservedModes:
    """Reads the modes of a batch of episodes; for environments whose rate loop is their own.

    Args:
        missions: the satellites that are flown; all with the same layout and decision period.
        share: of the limit of deflection that is used, at most 1.
        caution: standard deviations that a mode's frequency is taken lower than it is estimated.

    Raises:
        ValueError: a number is out of range, the environment takes torques, or modes are not observed.
    """

    def __init__(self, missions: Sequence[Mission], share: float, caution: float) -> None:
        first = missions[0]
        if first.control != "rate" or first.observation != "body":
            raise ValueError(
                "body rates are commanded through the environment's own loop, and panels and tanks are read from the "
                'observation: make it with control="rate" (satid: --control rate) and observation="body", got control '
                f"{first.control!r} and observation {first.observation!r}"
            )
        places = first.layout["modes"]
        swinging = next((own.satellite for own in missions if own.satellite.oscillators), None)
        if swinging is not None and places.start == places.stop:
            raise ValueError(
                f"the filter estimates no modes, so those of {swinging.name!r} cannot be spared: give an estimator "
                'that has them, such as "momentum"'
            )
        self._share = check_number("share", share, high=1.0, strict=True)
        self._caution = check_number("caution", caution)
        self._layout = first.layout
        self._lag = step_lag(first.scenario.tracking_bandwidth * first.scenario.decision_period)
        self._all_moments = np.stack([np.diag(mission.prior.inertia) for mission in missions])
        self._moments = self._all_moments[:1]
        self._sheet = np.zeros((0, 0, 2))  # w T and |d| of the data sheet, (N, modes)

    def assign(self, rows: np.ndarray) -> None:
        """Say which mission (N,) each episode of the batch flies; without it all fly the first."""
        self._moments = self._all_moments[rows]

    def state(self) -> np.ndarray:
        """Data sheets (N, modes, 2) that were noted, for `restore`."""
        return self._sheet.copy()

    def restore(self, state: np.ndarray) -> None:
        """Return to a `state`."""
        self._sheet = state.copy()

    def read(self, observation: np.ndarray) -> Modes:
        """Modes from observations (N, size); where an episode begins, what is believed is noted as the data sheet."""
        seen = {name: observation[:, self._layout[name]].astype(float) for name in _READ}
        modes = seen["modes"].reshape(len(observation), -1, sum(MODE_PARTS.values()))
        several = {name: modes[:, :, place : place + MODE_PARTS[name]] for name, place in MODE_PLACES.items()}
        part = {name: numbers[:, :, 0] for name, numbers in several.items()}
        moments = np.maximum(self._moments * (1.0 + seen["inertia"][:, :3]), 0.0)
        coupling = several["coupling"] * np.sqrt(moments)[:, None]
        size = np.linalg.norm(coupling, axis=2)
        self._note(np.stack([2.0 * np.pi * part["frequency"], size], axis=2), seen["time_left"][:, 0] >= 1.0)
        slower = np.maximum(np.exp(-self._caution * observed_std(part["frequency_std"])), TINY)
        turned = np.maximum(2.0 * np.pi * part["frequency"] * slower, TINY)
        own, limit = self._sheet[:, :, 0] / turned, part["deflection_limit"]
        given = np.where((limit > 0.0) & (limit < BOUND), limit, np.inf)  # 0 of a mode that no rotation excites
        return Modes(
            seen["rate"],
            seen["control_authority"] / STEPS,
            np.stack([part["deflection"], part["deflection_rate"] * own], axis=2),
            coupling / np.maximum(size, TINY)[:, :, None],
            size / np.maximum(self._sheet[:, :, 1], TINY) * own / turned,
            np.stack([np.cos(turned / STEPS), np.sin(turned / STEPS)], axis=2),
            turned,
            self._share * given,
            several["centrifugal"] / slower[:, :, None] ** 2,
        )

    def _note(self, sheet: np.ndarray, begins: np.ndarray) -> None:
        """Take what is believed of the modes (N, modes, 2) as the data sheet where an episode begins (N,)."""
        same = self._sheet.shape == sheet.shape
        self._sheet = np.where(begins[:, None, None], sheet, self._sheet) if same else sheet

    def peaks(self, modes: Modes, choices: np.ndarray) -> np.ndarray:
        """Largest deflection over its limit, (N, choices), of commands (N, choices, 3) that stay."""
        peaks = np.empty(choices.shape[:2])
        peaks_many(modes, np.ascontiguousarray(choices), self._lag, peaks)
        return peaks

    def peaks_of_turns(self, modes: Modes, choices: np.ndarray, decisions: int = 1) -> np.ndarray:
        """Largest deflection over its limit, (N, choices), of each held for some decisions, then the gentlest."""
        peaks = np.zeros(choices.shape[:2])
        if modes.limit.shape[1] > 0:
            peaks_of_turns_many(modes, np.ascontiguousarray(choices), self._lag, decisions, peaks)
        return peaks


@inline
def pulled_by(modes, i, m, rate):
    """Deflection to which the rotation pulls mode m of episode i at a rate over the limit."""
    K = modes.pull[i, m]
    return dot(rate, multiply((K[0], K[1], K[2], K[3], K[4], K[5]), rate))


@kernel
def pulled_many(modes, rates, pulled):
    """See `Modes.pulled`."""
    for i in range(rates.shape[0]):
        for c in range(rates.shape[1]):
            for m in range(pulled.shape[2]):
                pulled[i, c, m] = pulled_by(modes, i, m, load(rates[i, c]))


@inline
def _approach(rate, command, most, lag):
    """Change of a rate in a step."""
    return min(max(lag * (command - rate), -most), most)


@outline
def _steps(modes, i, command, lag, steps, rate, swing, enough):
    """Move rate (3,) and swing (modes, 2) of episode i on under a command; the largest deflection over its limit, or
    the first that is at least `enough`."""
    peak = 0.0
    for _ in range(steps):
        x = _approach(rate[0], command[0], modes.most[i, 0], lag)
        y = _approach(rate[1], command[1], modes.most[i, 1], lag)
        z = _approach(rate[2], command[2], modes.most[i, 2], lag)
        rate[0], rate[1], rate[2] = rate[0] + x, rate[1] + y, rate[2] + z
        for m in range(swing.shape[0]):
            cosine, sine = modes.turn[i, m]
            centre = -STEPS * modes.bent[i, m] * dot((x, y, z), load(modes.direction[i, m]))
            off, speed = swing[m, 0] - centre, swing[m, 1]
            swing[m, 0] = centre + off * cosine + speed * sine
            swing[m, 1] = speed * cosine - off * sine
            peak = max(peak, abs(swing[m, 0]) / modes.limit[i, m])
        if peak >= enough:
            break
    return peak


@outline
def _peak_if_kept(modes, i, command, lag, rate, swing, enough):
    """Largest deflection over its limit under a command that stays, ringing afterwards included; or the first that is
    at least `enough`."""
    peak = _steps(modes, i, command, lag, _AHEAD * STEPS, rate, swing, enough)
    for m in range(swing.shape[0]):
        peak = max(peak, np.hypot(swing[m, 0], swing[m, 1]) / modes.limit[i, m])
    return peak


@inline
def _copy(rate, swing, own_rate, own_swing):
    """Begin at a rate (3,) and swing (modes, 2)."""
    own_rate[0], own_rate[1], own_rate[2] = rate[0], rate[1], rate[2]
    for m in range(own_swing.shape[0]):
        own_swing[m, 0], own_swing[m, 1] = swing[m, 0], swing[m, 1]


@kernel
def peaks_many(modes, choices, lag, peaks):
    """See `ObservedModes.peaks`."""
    rate, swing = np.empty(3), np.empty((modes.swing.shape[1], 2))
    for i in range(choices.shape[0]):
        for c in range(choices.shape[1]):
            _copy(modes.rate[i], modes.swing[i], rate, swing)
            peaks[i, c] = _peak_if_kept(modes, i, choices[i, c], lag, rate, swing, np.inf)


@kernel
def peaks_of_turns_many(modes, choices, lag, decisions, peaks):
    """See `ObservedModes.peaks_of_turns`."""
    size = modes.swing.shape[1]
    turned, turned_swing, rate, swing = np.empty(3), np.empty((size, 2)), np.empty(3), np.empty((size, 2))
    for i in range(choices.shape[0]):
        for c in range(choices.shape[1]):
            _copy(modes.rate[i], modes.swing[i], turned, turned_swing)
            first = _steps(modes, i, choices[i, c], lag, decisions * STEPS, turned, turned_swing, np.inf)
            least = np.inf
            for after in range(choices.shape[1]):
                _copy(turned, turned_swing, rate, swing)
                least = min(least, _peak_if_kept(modes, i, choices[i, after], lag, rate, swing, least))
                if least <= first:
                    break
            peaks[i, c] = max(first, least)
