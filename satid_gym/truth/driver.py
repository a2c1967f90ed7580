"""Driver of a truth: gives it motor torque, and lets the core read, filter and judge what it answers."""

from __future__ import annotations

import numpy as np

from satid_gym.config import real_array
from satid_gym.core import kernels as core
from satid_gym.core.records import InertiaMode
from satid_gym.core.truth.speed_limit import AT_LIMIT
from satid_gym.fleet import DRAW_FAILED, Fleet
from satid_gym.rigid_body import inertia_tensor
from satid_gym.templates import EpisodeTemplates
from satid_gym.truth import kernels
from satid_gym.truth.drawn import drawn_episode
from satid_gym.truth.protocol import State, Truth

_UNIT = 1e-3  # by which the length of an attitude may differ from 1


class TruthDriver:
    """Flies a fleet of one on a truth.

    Args:
        truth: what moves the satellite.
        fleet: of the environment.

    Raises:
        ValueError: the problem has an inertia law and the truth does not follow it.
    """

    def __init__(self, truth: Truth, fleet: Fleet) -> None:
        self.truth, self._fleet = truth, fleet
        self._disturbance = np.zeros(3)
        law = fleet.problem.inertia
        self._check_law(law if isinstance(law, str) else law.mode)

    def begin(self, templates: EpisodeTemplates) -> None:
        """Start an episode.

        Raises:
            ValueError: no inertia drawn is physical, the truth refuses the episode, or what it answers is not valid;
                the episode is over.
        """
        rows = self._fleet.rows
        drawn = kernels.draw(rows, templates.records)
        rows.tasks["over"] = 1
        if not drawn:
            raise ValueError(DRAW_FAILED)
        plant, scenario = rows.plants[0], self._fleet.problem.scenario
        self._check_law(InertiaMode(int(plant["law"])).name.lower())
        satellite = scenario.operate(templates.satellites[int(rows.tasks["template"][0])])
        episode = drawn_episode(satellite, plant, scenario.sample_period)
        plant["change"], plant["knot_change"] = 0.0, 0.0  # from now on the inertia is what the truth says
        state = self._taken("start", self.truth.start(episode))
        self._check_readings(state)
        kernels.read(rows.plants)
        self._replace_readings(state)
        kernels.start(rows, self._fleet.work)
        rows.tasks["over"] = 0

    def decide(self, action: np.ndarray) -> None:
        """One decision of a compiled filter with an action, (n,) torques or (3,) rates.

        Raises:
            ValueError: what the truth answers is not valid; the episode is over.
            FloatingPointError: the filter broke down.
        """
        rows, work = self._fleet.rows, self._fleet.work
        task, report = rows.tasks[0], rows.reports[0]
        core.command(rows, work, action)
        first = core.uncertainty_nats(rows.beliefs, work, task["criterion"]) if task["net"] else 0.0
        for _ in range(task["samples"]):
            core.steer(rows, work)
            self.sample()
            kernels.believe(rows, work)
        if task["net"]:
            report["information_gain"] = first - core.uncertainty_nats(rows.beliefs, work, task["criterion"])
        core.conclude(rows, work)
        self._fleet.check(int(rows.beliefs["broken"][0]))

    def sample(self) -> None:
        """Truth and readings of one sample period.

        Raises:
            ValueError: what the truth answers is not valid; the episode is over.
        """
        rows, plant = self._fleet.rows, self._fleet.rows.plants[0]
        period, before = float(rows.tasks["sample_period"][0]), plant["rate"].copy()
        kernels.drive(rows, self._fleet.work, self._disturbance)
        rows.tasks["over"] = 1
        answer = self.truth.advance(plant["motor_torque"].copy(), self._disturbance.copy(), period)
        state = self._taken("advance", answer)
        self._check_readings(state)
        if state.attitude is None:
            kernels.turn_on(rows.plants, before, period)
        kernels.measure(rows)
        self._replace_readings(state)
        rows.tasks["over"] = 0

    def _check_law(self, mode: str) -> None:
        if mode != "static" and not getattr(self.truth, "follows_law", False):
            raise ValueError(
                f"the truth {type(self.truth).__name__} does not follow inertia laws, and inertia is {mode!r}: give "
                'inertia="static", or a truth whose `follows_law` is true'
            )

    def _check_readings(self, state: State) -> None:
        """Refuse readings that the environment cannot take from states, and faults of readings that are not its own."""
        plant, own = self._fleet.rows.plants[0], (state.gyro is not None, state.tachometer is not None)
        if plant["sampling"]["on"] and not all(own):
            raise ValueError(
                "sensors that integrate, count or are late read what happens between two states of the truth: leave "
                "them to a truth whose State has gyro and tachometer, or give sensors "
                "that neither integrate nor count, without delay"
            )
        if plant["faulty"] and any(own):
            raise ValueError("a truth that returns readings simulates their faults too: give a scenario without faults")

    def _taken(self, call: str, state: object) -> State:
        """Write a state to the plant, which is the truth that the core sees."""
        name, plant = f"{type(self.truth).__name__}.{call}", self._fleet.rows.plants[0]
        if not isinstance(state, State):
            raise ValueError(f"{name} must return a satid_gym.truth.State, got {type(state).__name__}")
        n, bends = len(plant["wheel_speed"]), plant["oscillators"]["deflection"]
        plant["rate"] = real_array(f"rate of {name}", state.rate, (3,))
        plant["wheel_speed"] = speed = real_array(f"wheel_speed of {name}", state.wheel_speed, (n,))
        plant["locked"] = np.abs(speed) >= plant["wheel_speed_max"] * (1.0 - AT_LIMIT)
        if state.inertia is None:
            if plant["gravity_gradient"]:
                raise ValueError(
                    f"{name} does not tell the inertia, which the gravity gradient needs: give "
                    'scenario={"gravity_gradient": False}'
                )
            plant["inertia"] = np.nan
        elif not np.array_equal(plant["inertia"], state.inertia):
            plant["inertia"] = inertia_tensor(state.inertia, f"inertia of {name}")
        if state.attitude is not None:
            attitude = real_array(f"attitude of {name}", state.attitude, (4,))
            length = float(np.linalg.norm(attitude))
            if abs(length - 1.0) > _UNIT:
                raise ValueError(f"attitude of {name} must be a quaternion of length 1, got length {length:g}")
            plant["attitude"] = attitude / length
        if len(bends):
            bends[:] = real_array(f"deflection of {name}", state.deflection, (len(bends),))
        return state

    def _replace_readings(self, state: State) -> None:
        """Take readings of the truth's own in place of the environment's."""
        plant = self._fleet.rows.plants[0]
        for field, value in (("gyro", state.gyro), ("tachometer", state.tachometer)):
            if value is not None:
                plant[field] = real_array(f"{field} of {type(self.truth).__name__}", value, plant[field].shape)
