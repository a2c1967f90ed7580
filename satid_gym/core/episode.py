"""Episode, decision by decision: action -> wheels -> body -> sensors -> filter -> reward -> observation.

Rows are independent, so any range of them can be stepped by any thread.
"""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import load, store
from satid_gym.core.belief import announcement, filters
from satid_gym.core.control.rate_tracking import track
from satid_gym.core.jit import inline, kernel, outline
from satid_gym.core.log import log_sample
from satid_gym.core.observation import observe
from satid_gym.core.random import uniform
from satid_gym.core.records import Autoreset
from satid_gym.core.report import assess, note_costs, note_nis, note_peaks
from satid_gym.core.reward import dispersion, nats, reward, uncertainty_nats
from satid_gym.core.sample import sample
from satid_gym.core.truth.draw import draw_plant
from satid_gym.core.truth.dynamics import spin_momentum
from satid_gym.core.truth.inertia_law import announced_share, is_released, moves_mass
from satid_gym.core.truth.sensors import read_sensors

_NEXT_STEP, _SAME_STEP, _BEGIN = int(Autoreset.NEXT_STEP), int(Autoreset.SAME_STEP), int(Autoreset.BEGIN)


@outline
def command(plant, task, work, report, action):
    """Take an action, the motor torque (n,) or the rate reference (3,) of the decision, and clear the tallies."""
    report.effort = report.information_gain = 0.0
    task.nis_sum, task.nis_count = 0.0, 0
    for k in range(action.shape[0]):
        fraction = min(max(np.float64(action[k]), -1.0), 1.0)
        task.command[k] = fraction
        if task.tracking.on != 0:
            task.tracking.reference[k] = fraction * task.rate_limit
        else:
            work.torque[k] = fraction * task.torque_max[k]
            report.effort += fraction * fraction / action.shape[0]
    for k in range(work.torque.shape[0]):
        report.saturated[k] = 0
        report.spin_start[k] = spin_momentum(plant, k)
    report.outside = report.in_avoided_band = report.tracking = report.bent = report.peak_bend = 0.0
    report.window_missed = report.in_keep_out = report.read_in_band = 0.0
    for f in range(report.faults.shape[0]):
        report.faults[f] = 0
    for i in range(3):
        report.peak_rate[i] = 0.0
    for k in range(report.deflection.shape[0]):
        report.deflection[k] = 0.0


@inline
def steer(plant, belief, task, work, report):
    """Let the rate loop, where it is on, choose the motor torque until the next readings."""
    if task.tracking.on == 0:
        return
    track(task, belief, plant.gyro, plant.tachometer, task.sample_period, work.torque)
    for k in range(work.torque.shape[0]):
        report.effort += (work.torque[k] / task.torque_max[k]) ** 2 / (work.torque.shape[0] * task.samples)


@inline
def announce(plant, belief, task):
    """Tell the filter what share of a deployment or release came in the last sample."""
    if moves_mass(plant):
        announcement.tell(belief, announced_share(plant, task.sample_period), 1 if is_released(plant) else 0)


@inline
def take_reading(plant, belief, work):
    """Update the belief with those of the present readings that are not flagged; NIS of gyro and tachometers."""
    if plant.gyro_flagged != 0:
        nis = filters.condition_wheels(belief, work, plant.tachometer)
    else:
        nis = filters.condition(belief, work, plant.gyro, plant.tachometer)
    if plant.tracker.fresh != 0:
        filters.condition_attitude(belief, work, plant.tracker.reading)
    return nis


@inline
def tell_window(plant, task):
    """Write to the task the imaging window that is open or comes next, as operators know it."""
    if task.tells_window != 0:
        task.opens, task.closes = plant.operations.opens, plant.operations.closes
        store(task.target, load(plant.operations.target))


@outline
def conclude(plant, belief, task, work, report, observation):
    """End a decision: reward, end of episode, assessment, observation."""
    task.decision += 1
    duration = task.sample_period * task.samples
    for k in range(plant.locked.shape[0]):
        mean = (spin_momentum(plant, k) - report.spin_start[k]) / duration
        limit = plant.torque_max[k] if plant.rubs == 0 else np.inf
        report.torque_applied[k] = min(max(mean, -limit), limit)  # what exceeds it is rounding
    report.outside /= task.samples
    report.in_avoided_band /= task.samples
    report.tracking /= task.samples
    note_costs(task, report)
    report.information_held = -uncertainty_nats(belief, work, task.criterion)
    report.reward = reward(task, report)
    fastest = max(abs(plant.rate[0]), abs(plant.rate[1]), abs(plant.rate[2]))
    report.terminated = 1 if fastest > task.termination_rate else 0
    for k in range(report.deflection.shape[0]):
        if report.deflection[k] > task.termination_deflection[k]:
            report.terminated = 1
    report.truncated = 1 if task.decision >= task.decisions and report.terminated == 0 else 0
    task.over = max(report.terminated, report.truncated)
    assess(plant, belief, work, report)
    tell_window(plant, task)
    observe(belief, task, plant.gyro, plant.tachometer, observation)


@inline
def believe(plant, belief, task, work, report):
    """Let the filter take in a sample's readings, and tally what they gave."""
    announce(plant, belief, task)
    filters.predict(belief, work, plant.tachometer, task.sample_period)
    before = dispersion(belief, work, task.criterion)
    report.nis = take_reading(plant, belief, work)
    note_peaks(plant, belief, report)
    note_nis(task, report.nis)
    report.information_gain += nats(belief, before / dispersion(belief, work, task.criterion), task.criterion)


@inline
def decide(rows, i, action, work):
    """One decision of row i."""
    plant, belief, task, report = rows.plants[i], rows.beliefs[i], rows.tasks[i], rows.reports[i]
    command(plant, task, work, report, action)
    first = uncertainty_nats(belief, work, task.criterion) if task.net != 0 else 0.0
    for step in range(task.samples):
        steer(plant, belief, task, work, report)
        sample(plant, task, work, report)
        believe(plant, belief, task, work, report)
        if rows.logs.shape[1] > 0:
            log_sample(rows.logs[i, step], plant, belief)
    if task.net != 0:
        report.information_gain = first - uncertainty_nats(belief, work, task.criterion)
    conclude(plant, belief, task, work, report, rows.observations[i])


@inline
def draw(rows, i, templates):
    """Draw an episode in row i, from a template drawn at random; False where no inertia drawn is physical."""
    plant = rows.plants[i]
    stream = plant.stream
    row = np.int64(uniform(stream) * templates.draws.shape[0])
    s0, s1, s2, s3 = stream[0], stream[1], stream[2], stream[3]
    rows.plants[i] = templates.plants[row]
    rows.beliefs[i] = templates.beliefs[row]
    rows.tasks[i] = templates.tasks[row]
    stream[0], stream[1], stream[2], stream[3] = s0, s1, s2, s3
    return draw_plant(templates.draws[row], plant)


@inline
def start(rows, i, work):
    """Let the filter take the first readings of the episode drawn in row i."""
    plant, belief, task, report = rows.plants[i], rows.beliefs[i], rows.tasks[i], rows.reports[i]
    filters.start(belief, work, plant.gyro, plant.tachometer)
    if plant.tracker.fresh != 0:
        filters.condition_attitude(belief, work, plant.tracker.reading)
    store(task.sun, load(plant.tracker.sun))  # by the ephemeris, which those who fly the satellite have
    for k in range(plant.locked.shape[0]):
        report.saturated[k] = 0
        report.torque_applied[k] = 0.0
    for f in range(report.faults.shape[0]):
        report.faults[f] = 0
    for k in range(report.deflection.shape[0]):
        report.deflection[k] = abs(plant.oscillators.deflection[k])
    report.reward = 0.0
    report.terminated = report.truncated = 0
    report.nis = report.information_gain = report.information_held = report.effort = 0.0
    report.outside = report.in_avoided_band = report.cost = 0.0
    report.tracking = plant.tracker.tracks
    for c in range(report.costs.shape[0]):
        report.costs[c] = 0.0
    if rows.logs.shape[1] > 0:
        log_sample(rows.logs[i, 0], plant, belief)
    assess(plant, belief, work, report)
    tell_window(plant, task)
    observe(belief, task, plant.gyro, plant.tachometer, rows.observations[i])


@inline
def begin(rows, i, templates, work):
    """Start an episode in row i; False where no inertia drawn is physical."""
    if not draw(rows, i, templates):
        return False
    read_sensors(rows.plants[i])
    start(rows, i, work)
    return True


@kernel
def step_many(span, mode, chosen, actions, rows, templates, work, final):
    """One decision of a span (low, high) of rows, and the new episodes that the Autoreset `mode` asks for.

    BEGIN starts an episode in every row where chosen[i] is not 0. In SAME_STEP the report and observation of an ended
    episode go to `final`. Returns how many rows failed: the covariance broke, or no new episode could be drawn.
    """
    failed = 0
    for i in range(span[0], span[1]):
        fresh = chosen[i] != 0 if mode == _BEGIN else mode == _NEXT_STEP and rows.tasks[i].over != 0
        ended = 0
        if not fresh and mode != _BEGIN:
            decide(rows, i, actions[i], work[0])
            failed += rows.beliefs[i].broken
            if mode == _SAME_STEP and rows.tasks[i].over != 0:
                final.reports[i] = rows.reports[i]
                for k in range(rows.observations.shape[1]):
                    final.observations[i, k] = rows.observations[i, k]
                fresh, ended = True, 1
        if fresh:
            if not begin(rows, i, templates, work[0]):
                failed += 1
            if ended != 0:
                report = rows.reports[i]
                report.terminated = final.reports[i].terminated
                report.truncated = final.reports[i].truncated
                report.reward = final.reports[i].reward
    return failed
