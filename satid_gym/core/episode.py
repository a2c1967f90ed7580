"""An episode, decision by decision: action -> wheels -> body -> sensors -> filter -> reward -> observation.

The kernels below are all that Python calls. Rows of the records are independent, so any range of them can be
stepped by any thread.
"""

from __future__ import annotations

import numpy as np

from satid_gym.core import faults, momentum_filter, rate_filter
from satid_gym.core.algebra import factor, mahalanobis, store_symmetric
from satid_gym.core.dynamics import inertia_at, spin_momentum, travel
from satid_gym.core.generator import draw_plant
from satid_gym.core.jit import inline, kernel, outline
from satid_gym.core.kalman import estimated_inertia
from satid_gym.core.observation import observe, rate_to_go_by
from satid_gym.core.random import uniform
from satid_gym.core.records import MOMENTUM
from satid_gym.core.reward import reward, saturated_share, spread
from satid_gym.core.sensors import drive_motors, read_sensors, walk_gyro_bias

NEXT_STEP, SAME_STEP, DISABLED, BEGIN = range(4)


@outline
def command(plant, task, work, report, action):
    """Turn an action (n,) into the motor torque of the decision, and clear the tallies."""
    effort = 0.0
    for k in range(action.shape[0]):
        fraction = min(max(np.float64(action[k]), -1.0), 1.0)
        task.command[k] = fraction
        work.torque[k] = fraction * task.torque_max[k]
        effort += fraction * fraction / action.shape[0]
        report.saturated[k] = 0
        report.spin_start[k] = spin_momentum(plant, k)
    report.effort = effort
    report.information_gain = 0.0
    report.outside = 0.0
    for f in range(report.faults.shape[0]):
        report.faults[f] = 0
    for i in range(3):
        report.peak_rate[i] = 0.0


@outline
def sample(plant, task, work, report):
    """Move the truth on by one sample period and read the sensors."""
    dt = task.sample_period
    if plant.faulty != 0:
        faults.note_motors(plant, report)
        faults.delay_command(plant, work.torque)
        drive_motors(plant, plant.torque_obeyed, dt)
    else:
        drive_motors(plant, work.torque, dt)
    end = (np.round(plant.time / dt) + 1.0) * dt  # so that rounding does not pile up
    travel(plant, plant.motor_torque, end - plant.time)
    plant.time = end
    walk_gyro_bias(plant, dt)
    read_sensors(plant)
    outside = False
    for i in range(3):
        outside = outside or abs(plant.rate[i]) > task.rate_limit
    if outside:
        report.outside += 1.0
    for k in range(plant.locked.shape[0]):
        report.saturated[k] = max(report.saturated[k], plant.locked[k])
    if plant.faulty != 0:
        faults.note_sensors(plant, report)


@inline
def predict(belief, work, tachometer, dt):
    """Move the belief on to the present reading of the tachometers."""
    if belief.kind == MOMENTUM:
        momentum_filter.predict(belief, work, tachometer, dt)
    else:
        rate_filter.predict(belief, work, tachometer, dt)


@inline
def condition(belief, work, gyro, tachometer):
    """Update the belief with the present readings; normalised innovation squared per degree of freedom."""
    if belief.kind == MOMENTUM:
        return momentum_filter.condition(belief, work, gyro) / 3.0
    return rate_filter.condition(belief, work, gyro, tachometer) / (3.0 + tachometer.shape[0])


@inline
def condition_wheels(belief, work, tachometer):
    """Update the belief with the tachometers alone; normalised innovation squared per degree of freedom."""
    if belief.kind == MOMENTUM:
        return 0.0
    return rate_filter.condition_wheels(belief, work, tachometer) / tachometer.shape[0]


@inline
def take_reading(plant, belief, work):
    """Update the belief with those of the present readings that are not flagged; normalised innovation squared.

    Without gyro the MomentumEKF has nothing to update: the tachometers are its prediction's input.
    """
    if plant.gyro_flagged != 0:
        belief.coasting = 1
        return condition_wheels(belief, work, plant.tachometer)
    if belief.gate == 0.0:
        belief.coasting = 0
    return condition(belief, work, plant.gyro, plant.tachometer)


@inline
def note_rate(plant, belief, report):
    """Tally the rate of this instant, as the filter goes by it: what the envelope's penalty is reckoned from."""
    rate = rate_to_go_by(belief, plant.gyro)
    for i in range(3):
        report.peak_rate[i] = max(report.peak_rate[i], abs(rate[i]))


@inline
def start_belief(belief, work, gyro, tachometer):
    """Belief after the first reading."""
    if belief.kind == MOMENTUM:
        momentum_filter.start(belief, work, gyro, tachometer)
    else:
        rate_filter.start(belief, gyro, tachometer)


@outline
def assess(plant, belief, work, report):
    """Hold the belief against the truth: for info and evaluation, never for reward or observation."""
    p = belief.prior_theta.shape[0]
    truth, estimate = inertia_at(plant, plant.time), estimated_inertia(belief)
    store_symmetric(report.inertia_true, truth)
    store_symmetric(report.inertia_estimate, estimate)
    error = size = 0.0
    for i in range(6):
        weight = 1.0 if i < 3 else 2.0
        error += weight * (estimate[i] - truth[i]) ** 2
        size += weight * truth[i] ** 2
    report.relative_error = np.sqrt(error / size)
    for k in range(p):
        work.theta[k] = belief.mean[3 + k] - truth[k]
    if factor(belief.covariance, 3, p, work.block) > 0.0:
        report.nees = mahalanobis(work.block, work.theta, p) / p
    else:
        belief.broken = 1
        report.nees = np.nan
    report.guarded, report.rejected = belief.guarded, belief.rejected
    report.time = plant.time


@outline
def conclude(plant, belief, task, work, report, observation):
    """End a decision: reward, end of episode, assessment, observation."""
    task.decision += 1
    duration = task.sample_period * task.samples
    for k in range(plant.locked.shape[0]):
        mean, limit = (spin_momentum(plant, k) - report.spin_start[k]) / duration, plant.torque_max[k]
        report.torque_applied[k] = min(max(mean, -limit), limit)  # what exceeds it is rounding
    report.outside /= task.samples
    report.cost = max(report.outside, saturated_share(report))
    report.information_held = -spread(belief, work, task.criterion)
    report.reward = reward(task, report)
    fastest = max(abs(plant.rate[0]), abs(plant.rate[1]), abs(plant.rate[2]))
    report.terminated = 1 if fastest > task.termination_rate else 0
    report.truncated = 1 if task.decision >= task.decisions and report.terminated == 0 else 0
    task.over = max(report.terminated, report.truncated)
    assess(plant, belief, work, report)
    observe(belief, task, plant.gyro, plant.tachometer, observation)


@inline
def decide(plant, belief, task, work, report, action, observation):
    """One decision of the environment."""
    command(plant, task, work, report, action)
    first = last = 0.0
    for step in range(task.samples):
        sample(plant, task, work, report)
        if step == 0:
            first = spread(belief, work, task.criterion)
        predict(belief, work, plant.tachometer, task.sample_period)
        before = spread(belief, work, task.criterion)
        report.nis = take_reading(plant, belief, work)
        note_rate(plant, belief, report)
        last = spread(belief, work, task.criterion)
        report.information_gain += before - last
    if task.net != 0:
        report.information_gain = first - last
    conclude(plant, belief, task, work, report, observation)


@inline
def begin(draw, plant, belief, task, work, report, observation):
    """Start an episode from fresh copies of the templates; False where no inertia drawn is physical."""
    if not draw_plant(draw, plant):
        return False
    read_sensors(plant)
    start_belief(belief, work, plant.gyro, plant.tachometer)
    for k in range(plant.locked.shape[0]):
        report.saturated[k] = 0
        report.torque_applied[k] = 0.0
    for f in range(report.faults.shape[0]):
        report.faults[f] = 0
    report.reward = 0.0
    report.terminated = report.truncated = 0
    report.nis = report.information_gain = report.information_held = report.effort = 0.0
    report.outside = report.cost = 0.0
    assess(plant, belief, work, report)
    observe(belief, task, plant.gyro, plant.tachometer, observation)
    return True


@inline
def _begin_row(i, draws, templates, plants, beliefs, tasks, work, reports, observations):
    """Start an episode in row i, from a template drawn at random."""
    stream = plants[i].stream
    row = np.int64(uniform(stream) * draws.shape[0])
    s0, s1, s2, s3 = stream[0], stream[1], stream[2], stream[3]
    plants[i] = templates[0][row]
    beliefs[i] = templates[1][row]
    tasks[i] = templates[2][row]
    stream[0], stream[1], stream[2], stream[3] = s0, s1, s2, s3
    return begin(draws[row], plants[i], beliefs[i], tasks[i], work, reports[i], observations[i])


def _build_step_many(fingerprint):
    def step_many(
        low,
        high,
        mode,
        chosen,
        actions,
        draws,
        templates,
        plants,
        beliefs,
        tasks,
        work,
        reports,
        observations,
        final_reports,
        final_observations,
    ):
        """One decision of rows low to high, and the new episodes that `mode` asks for.

        BEGIN starts an episode in every row where chosen[i] is not 0 and decides nothing. The other modes are
        Gymnasium's autoreset modes; in SAME_STEP what an ended episode leaves goes to final_reports and
        final_observations. Returns how many rows failed: the covariance broke, or no new episode could be
        drawn.
        """
        fingerprint  # noqa: B018
        failed = 0
        for i in range(low, high):
            fresh = chosen[i] != 0 if mode == BEGIN else mode == NEXT_STEP and tasks[i].over != 0
            ended = 0
            if not fresh and mode != BEGIN:
                decide(plants[i], beliefs[i], tasks[i], work[0], reports[i], actions[i], observations[i])
                failed += beliefs[i].broken
                if mode == SAME_STEP and tasks[i].over != 0:
                    final_reports[i] = reports[i]
                    for k in range(observations.shape[1]):
                        final_observations[i, k] = observations[i, k]
                    fresh, ended = True, 1
            if fresh:
                if not _begin_row(i, draws, templates, plants, beliefs, tasks, work[0], reports, observations):
                    failed += 1
                if ended != 0:
                    reports[i].terminated = final_reports[i].terminated
                    reports[i].truncated = final_reports[i].truncated
                    reports[i].reward = final_reports[i].reward
        return failed

    return step_many


step_many = kernel(_build_step_many)
