"""Worlds of the study of consistency: sensors and wheels, friction, sampling, sizes, horizons, modes, star trackers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from baselines.studies.worlds.satellites import (
    MINISAT,
    OBSERVATORY,
    POCKETQUBE,
    PYRAMIDS,
    with_panels,
    with_slosh,
)
from satid_gym.friction import WheelFriction
from satid_gym.satellite import BENCHMARK_SATELLITES, SATELLITES, Satellite
from satid_gym.sensors import Sensors
from satid_gym.star_tracker import StarTracker
from satid_gym.tolerances import Tolerances


@dataclass(frozen=True, kw_only=True)
class World:
    """World that is flown.

    Attributes:
        scenario: settings in which it differs from scenario "default".
        estimator: settings of the filter that such a world asks for, see "Weak excitation" in docs/estimators.md.
        control: what policies command.
        satellites: that it has of its own, in place of the study's.
        topic: of the table that shows it.
    """

    scenario: Mapping[str, Any] = field(default_factory=dict)
    estimator: Mapping[str, Any] = field(default_factory=dict)
    control: Literal["torque", "rate"] = "torque"
    satellites: tuple[Satellite, ...] = ()
    topic: Literal["calibration", "timing", "flexible", "tracker"] = "calibration"


def _flexible(change: Callable[..., Satellite], share: float, frequency: float) -> World:
    satellites = tuple(change(SATELLITES[name], share, frequency) for name in BENCHMARK_SATELLITES)
    return World(satellites=satellites, topic="flexible")


def _timed(sensors: Sensors, **tolerances: float) -> World:
    return World(scenario={"sensors": sensors, "tolerances": Tolerances(**tolerances)}, topic="timing")


def _off(estimator: Mapping[str, Any] | None = None, **tolerances: float) -> World:
    return World(scenario={"tolerances": Tolerances(**tolerances)}, estimator=estimator or {})


def _tracked(
    tracker: StarTracker, satellites: tuple[Satellite, ...] = (), sensors: Sensors | None = None, **tolerances: float
) -> World:
    seeing = (sensors or Sensors()).replace(star_tracker=tracker)
    scenario = {"sensors": seeing, "tolerances": Tolerances(**tolerances)}
    return World(scenario=scenario, satellites=satellites, topic="tracker")


_SHOWN_LATE = {"inertia_walk": 0.005}  # little excites, or time is short: what varies is not soon seen to
_LONG = {"inertia_walk_min": 3e-5}  # a flight so long that a smaller walk matters
_SMALL_WHEEL, _LARGE_WHEEL = WheelFriction(coulomb=1e-3, static=1.5e-3), WheelFriction(coulomb=0.01)
_ARCSEC, _DEGREE = np.pi / 648000.0, np.pi / 180.0
_GOOD = StarTracker(across_std=2.0 * _ARCSEC, round_std=20.0 * _ARCSEC, period=0.5)
_COARSE = StarTracker(across_std=10.0 * _ARCSEC, round_std=60.0 * _ARCSEC, period=0.5)
_LIMITED = _GOOD.replace(rate_limit=_DEGREE)
_BLINDED = _LIMITED.replace(sun_exclusion=30.0 * _DEGREE, earth_exclusion=10.0 * _DEGREE)
_LATE_GYRO = Sensors(gyro_integrates=True)
_PANELLED = tuple(with_panels(SATELLITES[name], 0.1, 0.35) for name in BENCHMARK_SATELLITES)
_SLOW = tuple(SATELLITES[name].replace(rate_limit=0.5 * _DEGREE) for name in BENCHMARK_SATELLITES)


WORLDS: Mapping[str, World] = {
    "as nominal": World(),
    "gyro bias 2e-5 rad/s": _off(gyro_bias=2e-5),
    "gyro bias 1e-4 rad/s": _off(gyro_bias=1e-4),
    "gyro bias 1e-3 rad/s": _off(_SHOWN_LATE, gyro_bias=1e-3),
    "gyro scale 0.1 %": _off(gyro_scale=1e-3),
    "gyro scale 1 %": _off(gyro_scale=1e-2),
    "gyro alignment 3 mrad": _off(gyro_alignment=3e-3),
    "rotor inertia 0.1 %": _off(wheel_inertia=1e-3),
    "rotor inertia 1 %": _off(wheel_inertia=1e-2),
    "wheel axes 1 mrad": _off(wheel_alignment=1e-3),
    "wheel axes 5 mrad": _off(wheel_alignment=5e-3),
    "all small errors": _off(
        gyro_bias=1e-4, gyro_scale=1e-3, gyro_alignment=1e-3, wheel_inertia=1e-3, wheel_alignment=1e-3
    ),
    "no torque noise": World(scenario={"torque_noise": 0.0}, estimator=_SHOWN_LATE),
    "gyro noise 1e-3 rad/s": World(scenario={"gyro_noise_std": 1e-3}, estimator=_SHOWN_LATE),
    "friction 1 of 10 mN m": World(scenario={"friction": _SMALL_WHEEL}, satellites=(SATELLITES["cubesat"],)),
    "friction 1 of 10 mN m, by rates": World(
        scenario={"friction": _SMALL_WHEEL},
        control="rate",
        satellites=(SATELLITES["cubesat"],),
    ),
    "friction 10 of 100 mN m": World(scenario={"friction": _LARGE_WHEEL}, satellites=(SATELLITES["microsat"],)),
    "friction 10 of 100 mN m, by rates": World(
        scenario={"friction": _LARGE_WHEEL},
        control="rate",
        satellites=(SATELLITES["microsat"],),
    ),
    "sample 1 s": World(scenario={"sample_period": 1.0}),
    "sample 0.02 s": World(scenario={"sample_period": 0.02}, satellites=(SATELLITES["microsat"],)),
    "1e-3 kg m^2": World(satellites=(POCKETQUBE,)),
    "1 kg m^2": World(satellites=(MINISAT,)),
    "1e4 kg m^2": World(satellites=(OBSERVATORY,)),
    "horizon 30 s": World(scenario={"horizon": 30.0}, estimator=_SHOWN_LATE),
    "horizon 3000 s": World(scenario={"horizon": 3000.0}, satellites=(SATELLITES["microsat"],), estimator=_LONG),
    "integrating gyro": _timed(Sensors(gyro_integrates=True)),
    "tachometers 1 late": _timed(Sensors(tachometer_delay=1.0)),
    "tachometers 0.9(3) late": _timed(Sensors(gyro_integrates=True, tachometer_delay=0.9), tachometer_delay=0.3),
    "24 pulses": _timed(Sensors(gyro_integrates=True, encoder_pulses=24)),
    "64 pulses": _timed(Sensors(gyro_integrates=True, encoder_pulses=64)),
    "64 pulses 0.9(1) late": _timed(
        Sensors(gyro_integrates=True, encoder_pulses=64, tachometer_delay=0.9), tachometer_delay=0.1
    ),
    "panels 2 %, 0.35 Hz": _flexible(with_panels, 0.02, 0.35),
    "panels 10 %, 0.1 Hz": _flexible(with_panels, 0.1, 0.1),
    "panels 10 %, 0.35 Hz": _flexible(with_panels, 0.1, 0.35),
    "panels 10 %, 1 Hz": _flexible(with_panels, 0.1, 1.0),
    "panels 25 %, 0.35 Hz": _flexible(with_panels, 0.25, 0.35),
    "slosh 3 %, 0.05 Hz": _flexible(with_slosh, 0.03, 0.05),
    "tracker, bias 2e-5 rad/s": _tracked(_GOOD, gyro_bias=2e-5),
    "tracker, bias 1e-4 rad/s": _tracked(_GOOD, gyro_bias=1e-4),
    "tracker, bias 1e-3 rad/s": _tracked(_GOOD, gyro_bias=1e-3),
    "tracker 10/10/60 arcsec, bias 1e-4 rad/s": _tracked(_COARSE, gyro_bias=1e-4),
    "tracker to 1 deg/s, bias 1e-4 rad/s": _tracked(_LIMITED, gyro_bias=1e-4),
    "tracker to 1 deg/s with Sun and Earth, bias 1e-4 rad/s": _tracked(_BLINDED, gyro_bias=1e-4),
    "tracker to 1 deg/s, flown to 0.5 deg/s, bias 1e-4 rad/s": _tracked(_LIMITED, _SLOW, gyro_bias=1e-4),
    "tracker, scale 0.1 %": _tracked(_GOOD, gyro_scale=1e-3),
    "tracker to 1 deg/s, scale 0.1 %": _tracked(_LIMITED, gyro_scale=1e-3),
    "tracker to 1 deg/s, flown to 0.5 deg/s, scale 0.1 %": _tracked(_LIMITED, _SLOW, gyro_scale=1e-3),
    "tracker, panels 10 %, 0.35 Hz, bias 1e-4 rad/s": _tracked(_GOOD, _PANELLED, gyro_bias=1e-4),
    "tracker, integrating gyro, bias 1e-4 rad/s": _tracked(_GOOD, sensors=_LATE_GYRO, gyro_bias=1e-4),
    "tracker, integrating gyro, tachometers 0.9(3) late, bias 1e-4 rad/s": _tracked(
        _GOOD, sensors=_LATE_GYRO.replace(tachometer_delay=0.9), gyro_bias=1e-4, tachometer_delay=0.3
    ),
    "tracker, 64 pulses 0.9(1) late, bias 1e-4 rad/s": _tracked(
        _GOOD,
        sensors=_LATE_GYRO.replace(encoder_pulses=64, tachometer_delay=0.9),
        gyro_bias=1e-4,
        tachometer_delay=0.1,
    ),
    "tracker, panels 10 %, 0.35 Hz, integrating gyro, bias 1e-4 rad/s": _tracked(
        _GOOD, _PANELLED, sensors=_LATE_GYRO, gyro_bias=1e-4
    ),
}
"""Worlds that are flown, by name."""


TILTED_PYRAMIDS = World(scenario={"tilt_std": 0.15}, satellites=PYRAMIDS)
"""World of four skewed wheels and a full tensor, of the studies of rate loops and of Basilisk."""
