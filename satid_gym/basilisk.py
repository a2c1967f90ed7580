"""Truth of Basilisk, an independent simulator (https://avslab.github.io/basilisk/); `pip install ".[basilisk]"`.

The only module of the library that imports Basilisk; no other module imports this one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

try:
    from Basilisk.architecture import messaging
    from Basilisk.simulation import (
        extForceTorque,
        hingedRigidBodyStateEffector,
        linearSpringMassDamper,
        reactionWheelStateEffector,
        spacecraft,
    )
    from Basilisk.utilities import SimulationBaseClass, macros, simIncludeRW
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        'Basilisk is missing: pip install ".[basilisk]" in the checkout', name="Basilisk"
    ) from error

from satid_gym.oscillators import Oscillator, Panel
from satid_gym.truth.protocol import Episode, State

_MASS = 100.0  # kg, of a satellite whose mass is not told; without oscillators none of its motion depends on it
_WHEELS = 36  # of a message


@dataclass(frozen=True, kw_only=True)
class Imbalance:
    """Imbalance of each wheel; the defaults are Basilisk's of a Honeywell HR16, a wheel of 0.2 N m.

    Attributes:
        static: kg m, mass times its distance from the axis.
        dynamic: kg m^2, product of inertia that leaves the axis.
    """

    static: float = 4.8e-6
    dynamic: float = 1.54e-6


class BasiliskTruth:
    """Rigid body, wheels with friction and imbalance, panels and slosh masses in Basilisk.

    The body is a hub that wheels, panels and slosh masses are put on, so that mass and inertia of the whole, at rest,
    are those of the episode's satellite. Friction is Basilisk's: stiction acts on a wheel that leaves rest, Coulomb and
    viscous friction on every one. A wheel at its speed limit gets no torque that drives it further.

    Args:
        step: s, of its Runge-Kutta method of fourth order; the next shorter one that divides the sample is taken.
        imbalance: of the wheels, which shake the body at their speed: then `step` must resolve a turn of the fastest.
    """

    def __init__(self, *, step: float = 0.02, imbalance: Imbalance | None = None) -> None:
        self.step, self.imbalance = step, imbalance

    def start(self, episode: Episode) -> State:
        """Build the simulation of an episode; the state at time 0.

        Raises:
            ValueError: a panel's arm is not across its hinge.
        """
        self.episode, self.time = episode, 0.0
        step = episode.sample_period / math.ceil(episode.sample_period / self.step - 1e-9)
        self.sim = SimulationBaseClass.SimBaseClass()
        process = self.sim.CreateNewProcess("process")
        process.addTask(self.sim.CreateNewTask("dynamics", macros.sec2nano(step)))
        self.body = self._hub()
        self.wheels = self._wheels()
        self.push = extForceTorque.ExtForceTorque()
        self.body.addDynamicEffector(self.push)
        self.moving = self._oscillators()
        self.sim.AddModelToTask("dynamics", self.wheels, 3)
        self.sim.AddModelToTask("dynamics", self.body, 2)
        for model in (self.push, *self.moving):
            self.sim.AddModelToTask("dynamics", model)
        self.observe(process)
        self.sim.InitializeSimulation()
        self.sim.ConfigureStopTime(0)
        self.sim.ExecuteSimulation()
        return self.state()

    def observe(self, process: Any) -> None:
        """Add models to the process before it starts; a subclass may add sensors here."""

    def advance(self, torque: np.ndarray, disturbance: np.ndarray, duration: float) -> State:
        """Advance by `duration` seconds of constant motor torque (n,) and external torque (3,), N m."""
        self.command.motorTorque = [*torque.tolist(), *[0.0] * (_WHEELS - len(torque))]
        self.command_message.write(self.command, self.sim.TotalSim.CurrentNanos)
        self.push.extTorquePntB_B = _column(disturbance)
        self.time += duration
        self.sim.ConfigureStopTime(macros.sec2nano(self.time))
        self.sim.ExecuteSimulation()
        return self.state()

    def state(self) -> State:
        """Present state."""
        body = self.body.scStateOutMsg.read()
        sigma, count = np.array(body.sigma_BN), self.episode.satellite.wheels.count
        square = sigma @ sigma
        return State(
            rate=np.array(body.omega_BN_B),
            wheel_speed=np.array(self.wheels.rwSpeedOutMsg.read().wheelSpeeds)[:count],
            inertia=self.episode.satellite.inertia,
            attitude=np.append(2.0 * sigma, 1.0 - square) / (1.0 + square),
            deflection=np.array([self._deflection(model) for model in self.moving]),
        )

    def _deflection(self, model: Any) -> float:
        if isinstance(model, hingedRigidBodyStateEffector.HingedRigidBodyStateEffector):
            return float(model.hingedRigidBodyOutMsg.read().theta)
        return float(self.body.dynManager.getStateObject(model.nameOfRhoState).getState()[0][0])

    def _hub(self) -> Any:
        """Hub: the satellite without panels and slosh masses; the centre of mass of the whole is B."""
        body, episode = spacecraft.Spacecraft(), self.episode
        own, mass = episode.satellite.oscillators, episode.satellite.mass or _MASS
        hub = mass - sum(o.count * o.mass for o in own)
        offset = -sum((o.mass * o.place for o in own if not o.mirrored), np.zeros(3)) / hub
        inertia = episode.satellite.inertia - sum((o.inertia_at_rest for o in own), np.zeros((3, 3)))
        inertia = inertia - hub * (offset @ offset * np.eye(3) - np.outer(offset, offset))
        body.hub.mHub, body.hub.r_BcB_B, body.hub.IHubPntBc_B = hub, _column(offset), inertia.tolist()
        body.hub.omega_BN_BInit = _column(episode.rate)
        q = episode.attitude if episode.attitude[3] >= 0.0 else -episode.attitude
        body.hub.sigma_BNInit = _column(q[:3] / (1.0 + q[3]))
        return body

    def _wheels(self) -> Any:
        given, factory = self.episode.satellite.wheels, simIncludeRW.rwFactory()
        friction, shaken = given.friction, self.imbalance
        for k in range(given.count):
            wheel = factory.create(
                "custom",
                given.axes[:, k].tolist(),
                Js=float(given.inertia[k]),
                Omega=float(self.episode.wheel_speed[k]) / macros.RPM,
                Omega_max=float(given.max_speed[k]) / macros.RPM,
                useMaxTorque=False,  # what is commanded is within the limit
                useRWfriction=friction.acts,
                fCoulomb=friction.coulomb,
                fStatic=friction.breakaway,
                cViscous=friction.viscous,
                betaStatic=friction.stribeck_speed,
                RWModel=messaging.BalancedWheels if shaken is None else messaging.JitterSimple,
            )
            if shaken is not None:
                wheel.U_s, wheel.U_d = shaken.static, shaken.dynamic
        wheels = reactionWheelStateEffector.ReactionWheelStateEffector()
        factory.addToSpacecraft("wheels", wheels, self.body)
        self.command = messaging.ArrayMotorTorqueMsgPayload()
        self.command_message = messaging.ArrayMotorTorqueMsg().write(self.command)
        wheels.rwMotorCmdInMsg.subscribeTo(self.command_message)
        return wheels

    def _oscillators(self) -> list[Any]:
        episode, found = self.episode, list[Any]()
        for o in episode.satellite.oscillators:
            for side in (1.0, -1.0)[: o.count]:
                start = float(episode.deflection[len(found)]), float(episode.deflection_rate[len(found)])
                model = _panel(o, side, *start) if isinstance(o, Panel) else _slosh(o, side, *start)
                rate = 2.0 * np.pi * o.frequency
                model.k, model.c = o.inertance * rate**2, 2.0 * o.damping * rate * o.inertance
                self.body.addStateEffector(model)
                found.append(model)
        return found


def _column(vector: np.ndarray) -> list[list[float]]:
    return np.asarray(vector)[:, None].tolist()


def _panel(panel: Panel, side: float, angle: float, rate: float) -> Any:
    """Panel, the first (side 1) or second (-1) of a mirrored pair; its centre of mass lies at -d s1, it turns about s2.

    Raises:
        ValueError: its arm is not across its hinge.
    """
    model = hingedRigidBodyStateEffector.HingedRigidBodyStateEffector()
    model.mass, model.d = panel.mass, float(np.linalg.norm(panel.arm))
    if abs(panel.arm @ panel.axis) > 1e-9 * model.d:
        raise ValueError(f"a panel of Basilisk has its arm across its axis, got arm {panel.arm}, axis {panel.axis}")
    first = -side * panel.arm / model.d
    frame = np.array([first, panel.axis, np.cross(first, panel.axis)])
    model.dcm_HB, model.IPntS_S = frame.tolist(), (frame @ panel.inertia @ frame.T).tolist()
    model.r_HB_B = _column(side * panel.hinge)
    model.thetaInit, model.thetaDotInit = angle, rate
    return model


def _slosh(mass: Oscillator, side: float, travel: float, rate: float) -> Any:
    model = linearSpringMassDamper.LinearSpringMassDamper()
    model.massInit, model.r_PB_B = mass.mass, _column(side * mass.place)
    model.pHat_B = _column(side * mass.tangent)
    model.rhoInit, model.rhoDotInit = travel, rate
    return model
