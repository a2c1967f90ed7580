"""Tachometers that may be stuck: which of their readings the filter takes, and what it takes for the others.

A noisy tachometer that repeats its reading to the bit is stuck; one without noise may repeat it. The counts of an
encoder repeat rightly while the wheel's speed changes by less than two pulses a sample. So it is stuck where commands
should have changed the speed by more than that, and than what a late reading does not show yet (`slack`); or by one
pulse (`suspect`), if readings of the gyro are rejected for as long as the count repeats: a wrong wheel speed shows in
these first, and would pass for a step of the inertia. To take a good encoder for stuck costs little: the filter is told
what the wheel did when the count changes (`unmeasured`).
Source: this project's design.
"""

from __future__ import annotations

from satid_gym.core.belief.unmeasured import RECOVERED, STUCK, shift
from satid_gym.core.jit import inline, outline


@inline
def take(belief, tachometer, torque, dt):
    """Write to gate.speed the wheel speeds (n,) that the filter uses, to belief.stuck the state of the tachometers.

    A wheel whose tachometer is stuck is taken to follow the commanded `torque` (n,). Returns whether one was stuck in
    the last sample while the filter coasted.
    """
    gate, unobserved = belief.gate, False
    for k in range(tachometer.shape[0]):
        unobserved = unobserved or (belief.stuck[k] == STUCK and belief.coasting != 0)
        change = torque[k] * dt / belief.wheel_inertia[k]
        same = tachometer[k] == gate.last_speed[k]
        gate.last_speed[k] = tachometer[k]
        if same:
            gate.unseen[k], gate.repeats[k] = gate.unseen[k] + change, gate.repeats[k] + 1
        else:
            gate.unseen[k], gate.repeats[k], gate.doubted[k] = 0.0, 0, 0
        if same and (belief.stuck[k] == STUCK or gate.doubted[k] != 0 or abs(gate.unseen[k]) >= gate.slack[k]):
            gate.speed[k] += change if belief.stuck[k] == STUCK else gate.unseen[k]
            belief.stuck[k] = STUCK
        else:
            if belief.stuck[k] == STUCK:
                shift(belief, k, belief.wheel_inertia[k] * (tachometer[k] - gate.speed[k]))
            gate.speed[k] = tachometer[k]
            belief.stuck[k] = RECOVERED if belief.stuck[k] == STUCK else 0
    return unobserved


@outline
def doubt_repeats(belief):
    """Doubt counts of pulses that have repeated for as long as readings are rejected; whether there are any."""
    gate, found = belief.gate, False
    for k in range(belief.stuck.shape[0]):
        repeats = gate.repeats[k] >= gate.since_rejection and abs(gate.unseen[k]) >= gate.suspect[k]
        if repeats and belief.stuck[k] != STUCK:
            gate.doubted[k], found = 1, True
    return found
