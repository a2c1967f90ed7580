"""Rollouts: flights rehearsed a decision at a time, with the observation that a policy would then have, compiled."""

from __future__ import annotations

from satid_gym.control.planning.rehearsal import begin, decide, write_speeds
from satid_gym.core.algebra import store
from satid_gym.core.belief import calibration, filters
from satid_gym.core.jit import kernel
from satid_gym.core.observation import observe


@kernel
def begin_rollouts(trail, flights, each, caution):
    """Write the rows of a `Trail`: each of the `Flights` as it is, `each` times."""
    for row in range(trail.losses.shape[0]):
        begin(trail, row, flights, row // each, caution)


@kernel
def roll_out(trail, actions, miss, scratch, observations):
    """Fly a decision in each row; adds to the losses what it loses, and writes what would be observed (R, size).

    Args:
        trail: `Trail` of R rows.
        actions: (R, 3) rates over their limit.
        miss: weight of imaging windows, see `rehearsal.decide`.
        scratch: `Scratch`.
        observations: written.
    """
    for row in range(actions.shape[0]):
        trail.losses[row] += decide(trail, row, actions[row], miss, scratch)
        belief, task = trail.beliefs[row], trail.tasks[row]
        for i in range(3):
            task.command[i] = actions[row, i]
        task.nis_sum, task.nis_count = 0.0, 0  # an expected reading has none
        omega = filters.rate(belief)
        store(scratch.gyro, calibration.reading_of(belief, omega))
        write_speeds(belief, trail.spins[row], omega, scratch.tachometer)
        observe(belief, task, scratch.gyro, scratch.tachometer, observations[row])
