"""Rate commands that keep panels and tanks inside their limit of deflection.

A mode that is excited by an acceleration a of the body swings about eta_0 = -d . a / w^2. The command in force goes
towards the wanted one as far as that leaves each mode inside a share of its limit if the rates then stay: while they
settle, and ringing afterwards. So what was found to be inside stays possible at the next decision. Where nothing on the
way is inside, because the filter knows better now, the change along d that rings least is taken.

Rates are foreseen as those of the environment's own loop: a first-order lag, as quick as the wheels' torque allows each
axis. w is the filter's estimate less some of its standard deviations, for a slower mode bends further. Damping, which
is small, is left out. `ShapedSquarePolicy` has the units of what is observed of a mode, and a law of the same kind for
rates that change within a decision.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.rate_loop import RateMargin
from satid_gym.core.observation import BOUND, MODE_PARTS, observed_std
from satid_gym.policy import Mission

_PLACES = dict(zip(MODE_PARTS, np.cumsum([0, *MODE_PARTS.values()]).tolist(), strict=False))
_TINY = 1e-12  # of a length, so that none is divided by 0
_WAYS = np.array([0.0, 0.02, 0.04, 0.08, 0.15, 0.25, 0.4, 0.6, 0.8, 1.0])  # shares of the way that are tried
_DAMPING = np.linspace(-2.0, 2.0, 17)  # changes along d, rate limits
_AHEAD = 8  # decisions in which rates settle
_STEPS = 4  # of a decision, in which accelerations are taken to be constant


class ModeLimit:
    """Turns rate commands into actions that spare the modes; for environments whose rate loop is their own.

    Args:
        missions: the satellites that are flown; all with the same layout and decision period.
        margin: see `RateMargin`.
        share: of the limit of deflection that is used, at most 1.
        caution: standard deviations that a mode's frequency is taken lower than it is estimated.

    Raises:
        ValueError: a number is out of range, the environment takes torques, or modes are not observed.
    """

    def __init__(self, missions: Sequence[Mission], margin: float, share: float = 0.9, caution: float = 1.0) -> None:
        first = missions[0]
        if first.control != "rate" or first.observation != "body":
            raise ValueError(
                "modes are spared where they are observed and the rate loop is the environment's own: make it with "
                'control="rate" and observation="body"'
            )
        self._share = check_number("share", share, high=1.0, strict=True)
        self._caution = check_number("caution", caution)
        self._margin, self._layout = RateMargin(missions, margin), first.layout
        self._step = first.scenario.decision_period / _STEPS
        self._lag = 1.0 - np.exp(-first.scenario.tracking_bandwidth * self._step)
        self._all_moments = np.stack([np.diag(mission.prior.inertia) for mission in missions])
        self._moments = self._all_moments[:1]
        self._sheet = np.zeros((0, 0, 2))  # w T and |d| of the data sheet, (N, modes)

    def assign(self, rows: np.ndarray) -> None:
        """Say which mission (N,) each episode of the batch flies; without it all fly the first."""
        self._margin.assign(rows)
        self._moments = self._all_moments[rows]

    def state(self) -> np.ndarray:
        """Data sheets (N, modes, 2) that were noted, for `restore`."""
        return self._sheet.copy()

    def restore(self, state: np.ndarray) -> None:
        """Return to a `state`."""
        self._sheet = state.copy()

    def __call__(self, observation: np.ndarray, command: np.ndarray) -> np.ndarray:
        """Action (N, 3) for observations (N, size) and rate commands (N, 3) in [-1, 1]."""
        wanted = self._margin(observation, command)
        seen = {name: observation[:, place].astype(float) for name, place in self._layout.items()}
        modes = seen["modes"].reshape(len(observation), -1, sum(MODE_PARTS.values()))
        if modes.shape[1] == 0:
            return wanted
        part = {name: modes[:, :, place] for name, place in _PLACES.items()}
        moments = np.maximum(self._moments * (1.0 + seen["inertia"][:, :3]), 0.0)
        coupling = modes[:, :, _PLACES["coupling"] : _PLACES["coupling"] + 3] * np.sqrt(moments)[:, None]
        size = np.linalg.norm(coupling, axis=2)
        self._note(np.stack([2.0 * np.pi * part["frequency"], size], axis=2), seen["time_left"][:, 0] >= 1.0)
        turned = 2.0 * np.pi * part["frequency"] * np.exp(-self._caution * observed_std(part["frequency_std"]))
        turned = np.maximum(turned, _TINY)
        own, limit = self._sheet[:, :, 0] / turned, part["deflection_limit"]
        given = np.where((limit > 0.0) & (limit < BOUND), limit, np.inf)  # 0 of a mode that no rotation excites
        modal = {
            "state": part["deflection"] + 1j * part["deflection_rate"] * own,
            "direction": coupling / np.maximum(size, _TINY)[:, :, None],
            "bent": size / np.maximum(self._sheet[:, :, 1], _TINY) * own / turned * _STEPS,  # by change in a step
            "turn": np.exp(-1j * turned / _STEPS),
            "limit": self._share * given,
        }
        held, body = seen["command"], np.stack([seen["rate"], seen["control_authority"] / _STEPS], axis=1)
        choices = held[:, None] + _WAYS[:, None] * (wanted - held)[:, None]
        spared = _peaks(choices, body, modal, self._lag) <= 1.0
        last = len(_WAYS) - 1 - np.argmax(spared[:, ::-1], axis=1)
        action = choices[np.arange(len(held)), last]
        rings = np.flatnonzero(~spared.any(axis=1))
        if len(rings):
            ringing = {name: value[rings] for name, value in modal.items()}
            most = np.argmax(np.abs(ringing["state"]) / ringing["limit"], axis=1)
            along = ringing["direction"][np.arange(len(rings)), most]
            edge = self._margin(observation, np.ones(3))[rings, None]
            choices = np.clip(held[rings, None] + _DAMPING[:, None] * along[:, None], -edge, edge)
            best = np.argmin(_peaks(choices, body[rings], ringing, self._lag), axis=1)
            action[rings] = choices[np.arange(len(rings)), best]
        return action

    def _note(self, sheet: np.ndarray, begins: np.ndarray) -> None:
        """Take what is believed of the modes (N, modes, 2) as the data sheet where an episode begins (N,)."""
        same = self._sheet.shape == sheet.shape
        self._sheet = np.where(begins[:, None, None], sheet, self._sheet) if same else sheet


def _peaks(choices: np.ndarray, body: np.ndarray, modal: dict[str, np.ndarray], lag: float) -> np.ndarray:
    """Largest deflection over its limit, (N, choices), of commands (N, choices, 3) that stay.

    Args:
        choices: the commands, rate limits.
        body: rates now, and the most that a step changes them, (N, 2, 3).
        modal: of each mode, (N, modes): its state, the change that bends it by how much and turns it by what, and the
            limit.
        lag: part of the way to the command that the rate goes in a step.
    """
    rate, most = np.broadcast_to(body[:, None, 0], choices.shape), body[:, None, 1]
    state, bent = modal["state"][:, None], modal["bent"][:, None]
    turn, direction = modal["turn"][:, None], modal["direction"].swapaxes(1, 2)
    peak = np.zeros(choices.shape[:2] + bent.shape[2:])
    for _ in range(_AHEAD * _STEPS):
        change = np.clip(lag * (choices - rate), -most, most)
        rate = rate + change
        centre = -bent * (change @ direction)
        state = centre + (state - centre) * turn
        peak = np.maximum(peak, np.abs(state.real))
    return (np.maximum(peak, np.abs(state)) / modal["limit"][:, None]).max(axis=2)
