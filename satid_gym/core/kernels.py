"""The compiled functions that Python calls, apart from those that step whole episodes.

Every record argument is an array of which row 0 is used.
"""

from __future__ import annotations

from satid_gym.core import episode
from satid_gym.core.algebra import store_symmetric
from satid_gym.core.dynamics import advance, inertia_at, set_momenta, set_speeds, spin_momentum
from satid_gym.core.jit import kernel
from satid_gym.core.reward import spread as spread_of


def _simulate(fingerprint):
    def simulate(plants, torque, dt, substeps, momentum, rate, wheel_speed, attitude, inertia, applied):
        """Fly `torque` (N, n), each held dt seconds, from the rate and wheel speed in the plant."""
        fingerprint  # noqa: B018
        plant = plants[0]
        set_momenta(plant)
        set_speeds(plant)
        for i in range(torque.shape[0] + 1):
            momentum[i] = plant.momentum
            rate[i] = plant.rate
            wheel_speed[i] = plant.wheel_speed
            attitude[i] = plant.attitude
            store_symmetric(inertia[i], inertia_at(plant, plant.time))
            if i == torque.shape[0]:
                break
            for k in range(torque.shape[1]):
                limit = plant.torque_max[k]
                plant.motor_torque[k] = min(max(torque[i, k], -limit), limit)
                applied[i, k] = -spin_momentum(plant, k)
            start = plant.time
            for s in range(substeps):
                # the end of each substep is computed from the start, so that no rounding piles up
                advance(plant, plant.motor_torque, start + (s + 1) * dt / substeps - plant.time)
            for k in range(torque.shape[1]):
                mean, limit = (applied[i, k] + spin_momentum(plant, k)) / dt, plant.torque_max[k]
                applied[i, k] = min(max(mean, -limit), limit)  # what exceeds it is rounding

    return simulate


def _law_inertia(fingerprint):
    def law_inertia(plants, times, out):
        """True inertia at times (N,), which must not decrease, to out (N, 3, 3)."""
        fingerprint  # noqa: B018
        plant = plants[0]
        for i in range(times.shape[0]):
            plant.stepped = 1 if times[i] >= plant.law_time else 0
            store_symmetric(out[i], inertia_at(plant, times[i]))

    return law_inertia


def _start_filter(fingerprint):
    def start_filter(beliefs, work, gyro, tachometer):
        """Belief after the first reading."""
        fingerprint  # noqa: B018
        episode.start_belief(beliefs[0], work[0], gyro, tachometer)

    return start_filter


def _predict_filter(fingerprint):
    def predict_filter(beliefs, work, tachometer, dt):
        """Move the belief on by dt seconds to the reading `tachometer` (n,)."""
        fingerprint  # noqa: B018
        episode.predict(beliefs[0], work[0], tachometer, dt)

    return predict_filter


def _condition_filter(fingerprint):
    def condition_filter(beliefs, work, gyro, tachometer):
        """Update the belief with a reading; normalised innovation squared per degree of freedom."""
        fingerprint  # noqa: B018
        return episode.condition(beliefs[0], work[0], gyro, tachometer)

    return condition_filter


def _condition_filter_wheels(fingerprint):
    def condition_filter_wheels(beliefs, work, tachometer):
        """Update the belief with the tachometers alone; normalised innovation squared per degree of freedom."""
        fingerprint  # noqa: B018
        return episode.condition_wheels(beliefs[0], work[0], tachometer)

    return condition_filter_wheels


def _run_filter(fingerprint):
    def run_filter(beliefs, work, gyro, tachometer, dt, mean, covariance, nis):
        """Filter readings gyro (N, 3) and tachometer (N, n), the first of which starts the belief."""
        fingerprint  # noqa: B018
        belief, scratch = beliefs[0], work[0]
        episode.start_belief(belief, scratch, gyro[0], tachometer[0])
        mean[0], covariance[0], nis[0] = belief.mean, belief.covariance, 0.0
        for i in range(1, gyro.shape[0]):
            episode.predict(belief, scratch, tachometer[i], dt)
            nis[i] = episode.condition(belief, scratch, gyro[i], tachometer[i])
            mean[i], covariance[i] = belief.mean, belief.covariance

    return run_filter


def _command(fingerprint):
    def command(plants, tasks, work, reports, action):
        """First part of a decision for an estimator that is not compiled."""
        fingerprint  # noqa: B018
        episode.command(plants[0], tasks[0], work[0], reports[0], action)

    return command


def _sample(fingerprint):
    def sample(plants, tasks, work, reports):
        """Truth and sensors of one sample period."""
        fingerprint  # noqa: B018
        episode.sample(plants[0], tasks[0], work[0], reports[0])

    return sample


def _note_rate(fingerprint):
    def note_rate(plants, beliefs, reports):
        """Tally the rate after a sample's update."""
        fingerprint  # noqa: B018
        episode.note_rate(plants[0], beliefs[0], reports[0])

    return note_rate


def _spread(fingerprint):
    def spread(beliefs, work, criterion):
        """Uncertainty of theta in nats."""
        fingerprint  # noqa: B018
        return spread_of(beliefs[0], work[0], criterion)

    return spread


def _conclude(fingerprint):
    def conclude(plants, beliefs, tasks, work, reports, observation):
        """Last part of a decision."""
        fingerprint  # noqa: B018
        episode.conclude(plants[0], beliefs[0], tasks[0], work[0], reports[0], observation)

    return conclude


def _look(fingerprint):
    def look(plants, beliefs, tasks, work, reports, observation):
        """Assessment and observation of the present belief."""
        fingerprint  # noqa: B018
        episode.assess(plants[0], beliefs[0], work[0], reports[0])
        episode.observe(beliefs[0], tasks[0], plants[0].gyro, plants[0].tachometer, observation)

    return look


simulate = kernel(_simulate)
law_inertia = kernel(_law_inertia)
start_filter = kernel(_start_filter)
predict_filter = kernel(_predict_filter)
condition_filter = kernel(_condition_filter)
condition_filter_wheels = kernel(_condition_filter_wheels)
run_filter = kernel(_run_filter)
command = kernel(_command)
sample = kernel(_sample)
note_rate = kernel(_note_rate)
spread = kernel(_spread)
conclude = kernel(_conclude)
look = kernel(_look)
