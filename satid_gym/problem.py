"""Problem that an environment poses: satellites, inertia law, scenario, estimator, reward."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from satid_gym.config import Config, check_integer, unknown_name
from satid_gym.core.observation import Form, layout
from satid_gym.estimators.inertia import PARAMETER_COUNT, Parameters, products_of_inertia
from satid_gym.estimators.registry import estimator_settings, preset_name
from satid_gym.estimators.settings import EstimatorSettings
from satid_gym.laws import MASS_MODES, InertiaLaw
from satid_gym.modes import check_sampling
from satid_gym.oscillators import oscillator_counts
from satid_gym.resolution import (
    InertiaLike,
    SatelliteLike,
    ScenarioLike,
    resolve_inertia,
    resolve_satellites,
    resolve_scenario,
)
from satid_gym.reward import RewardSettings, reward_settings
from satid_gym.satellite import SATELLITES, Satellite
from satid_gym.scenario import Scenario

CONTROLS = ("torque", "rate")


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem(Config):
    """Everything that defines an environment, resolved and checked.

    Attributes:
        satellites: an episode draws one of them; all have the same number of wheels.
        inertia: "random", a mode whose law is drawn from the scenario's ranges, or one exact law.
        scenario: the world.
        estimator: settings of the filter; `parameters` that were left open are settled here: "full" where a
            satellite, the law or the scenario has products of inertia about the body axes, else "principal".
        reward: what pays.
        include_covariance: whether the filter's whole covariance is observed.
        control: what an action is, "torque" of each wheel or the body "rate" that the rate loop tracks.
        observation: "wheels" one by one, or "body": what they do to the body, however many there are.
        include_walk: whether the random walk of the inertia that the filter uses is observed.

    Raises:
        ValueError: control or observation is unknown, "principal" would leave out products of inertia, or satellites
            differ in what a filter has states for: wheels, oscillators, kinds of tolerances, sensors.
    """

    satellites: tuple[Satellite, ...]
    inertia: str | InertiaLaw
    scenario: Scenario
    estimator: EstimatorSettings
    reward: RewardSettings
    include_covariance: bool = False
    control: str = "torque"
    observation: Form = "wheels"
    include_walk: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.control not in CONTROLS:
            raise unknown_name("control", self.control, CONTROLS)
        counts = {s.wheels.count for s in self.satellites}
        if len(counts) != 1:
            raise ValueError(f"all satellites of an environment need the same number of wheels, got {sorted(counts)}")
        sheets = [self.scenario.operate(s) for s in self.satellites]
        own, kinds = self.estimator, "tolerances of the same kinds (gyro bias, scale and alignment; delay; wheels)"
        self._check_alike([s.tolerances.kinds for s in sheets], kinds, "tolerances")
        if len({oscillator_counts(s.oscillators) for s in self.satellites}) != 1:
            raise ValueError(
                "all satellites of an environment need as many oscillators, and as many of them mirrored, got "
                + ", ".join(
                    f"{len(s.oscillators)} ({sum(oscillator_counts(s.oscillators))} with mirrors) of {s.name}"
                    for s in self.satellites
                )
            )
        self._check_alike([s.sensors.star_tracker is None for s in sheets], "a star tracker or none", "sensors")
        self._check_alike(
            [own.tells_sky(s) for s in sheets], "star trackers that the same bodies blind, Sun or Earth", "sensors"
        )
        self._check_alike(
            [(own.other_states(s), s.sensors.are_timed) for s in sheets],
            "encoders or none, and readings of an instant or not",
            "sensors",
        )
        bands = [self.observation == "body" and s.wheels.have_null_motion for s in sheets]
        self._check_alike(bands, "wheels that avoid a band of speed or none", "wheels")
        for tracker in filter(None, (s.sensors.star_tracker for s in sheets)):
            tracker.samples(self.scenario.sample_period)
            tracker.check_sky(self.scenario.orbit_rate)
        if self.scenario.operations is not None and not all(map(self.estimator.tells_attitude, sheets)):
            raise ValueError(
                f"scenario {self.scenario.name!r} has imaging windows, and a payload is pointed by the estimated "
                "attitude: give scenario sensors with a star_tracker, and a filter that takes its readings, such as "
                '"adaptive" or "momentum"'
            )
        for satellite in self.satellites:
            check_sampling(satellite.name, satellite.modes, satellite.inertia, self.scenario.sample_period)
        missed = self._products()
        if self.estimator.parameters is None:
            settled = self.estimator.replace(parameters="full" if missed else "principal")
            object.__setattr__(self, "estimator", settled)
        elif missed:
            self.check_parameters(missed)

    def _check_alike(self, values: Sequence[object], what: str, part: str) -> None:
        """Check that something is the same of all satellites, which `part` of a scenario would make it.

        Raises:
            ValueError: it is not.
        """
        if len(set(values)) != 1:
            raise ValueError(
                f"all satellites of an environment need {what}, because they share a filter and an observation: those "
                f"of {', '.join(s.name for s in self.satellites)} differ; give scenario {part}, which replace theirs"
            )

    def filter_needs(self, sheet: Satellite) -> tuple[object, ...]:
        """What the filter's states follow from: satellites that share a filter agree in it.

        Args:
            sheet: the satellite as the scenario operates it.
        """
        sensors, own = sheet.sensors, self.estimator
        seen = (sensors.are_timed, sensors.star_tracker is None, own.tells_sky(sheet))
        return (sheet.tolerances.kinds, *seen, own.other_states(sheet))

    def _products(self) -> str:
        """Description of what has products of inertia about the body axes; "" if nothing has."""
        changes = self.inertia.changes if isinstance(self.inertia, InertiaLaw) else ()
        for satellite in self.satellites:
            moments = np.diag(satellite.inertia)
            if found := products_of_inertia(satellite.inertia, moments):
                return f"satellite {satellite.name!r} has products of inertia about the body axes, {found}"
            for change in changes:
                if found := products_of_inertia(change, moments):
                    return f"the inertia law's change has products of inertia about the body axes, {found}"
        if self.inertia in MASS_MODES:
            return f"a {self.inertia} moves a mass to or from a place that is drawn, so there are products of inertia"
        if self.scenario.tilt_std > 0.0:
            return f"the scenario tilts the principal axes out of the body axes, tilt_std = {self.scenario.tilt_std:g}"
        return ""

    def check_parameters(self, missed: str) -> None:
        """Refuse a filter of three moments for what has products of inertia.

        Args:
            missed: what has them, in words.

        Raises:
            ValueError: the filter estimates three moments.
        """
        if self.parameters == "principal":
            name = preset_name(self.estimator)
            raise ValueError(
                f'{missed}: a filter with parameters "principal" leaves products of inertia out and is far off without '
                f'saying so. Make the environment with estimator={{"name": "{name}", "parameters": '
                '"full"}, or without parameters: it then takes what its satellites, law and scenario need'
            )

    @property
    def parameters(self) -> Parameters:
        """What the filter estimates: "principal" moments or the "full" tensor."""
        assert self.estimator.parameters is not None  # settled when this was built
        return self.estimator.parameters

    @property
    def wheels(self) -> int:
        """Number of wheels n."""
        return self.satellites[0].wheels.count

    @property
    def actions(self) -> int:
        """Number of entries of an action: a torque for each wheel, or a rate about each body axis."""
        return self.wheels if self.control == "torque" else 3

    @property
    def tells_sky(self) -> tuple[bool, bool]:
        """Whether the directions of Sun and Earth are observed: if they blind a star tracker, or a payload."""
        sun, earth = self.estimator.tells_sky(self.scenario.operate(self.satellites[0]))
        return sun or self.scenario.operations is not None, earth

    @property
    def layout(self) -> dict[str, slice]:
        """Places of the observation's parts by name, in order."""
        sheet, p = self.scenario.operate(self.satellites[0]), PARAMETER_COUNT[self.parameters]
        others = self.estimator.other_states(sheet) if self.include_covariance else 0
        return layout(
            self.wheels,
            p,
            others,
            self.observation,
            self.estimator.mode_count(sheet),
            self.actions,
            self.estimator.tells_attitude(sheet),
            self.include_walk,
            self.tells_sky,
            self.scenario.operations is not None,
            sheet.wheels.have_null_motion,
        )


def problem(
    satellite: SatelliteLike = "microsat",
    inertia: InertiaLike = "random",
    scenario: ScenarioLike = "default",
    estimator: str | Mapping[str, Any] | EstimatorSettings | None = None,
    reward: str | Mapping[str, Any] | RewardSettings | None = None,
    max_episode_steps: int | None = None,
    include_covariance: bool = False,
    control: str = "torque",
    observation: Form = "wheels",
    include_walk: bool = False,
) -> Problem:
    """Problem from the arguments of `gymnasium.make`.

    Raises:
        ValueError: a name is unknown or a value is not valid, or two horizons are given.
    """
    world = resolve_scenario(scenario)
    if max_episode_steps is not None:
        steps = check_integer("max_episode_steps", max_episode_steps)
        horizon = steps * world.decision_period
        if isinstance(scenario, Mapping) and "horizon" in scenario and not np.isclose(horizon, world.horizon):
            given = f"max_episode_steps={steps} makes a horizon of {horizon:g} s, and the scenario's settings say"
            raise ValueError(f"{given} {world.horizon:g} s: give one of the two")
        world = world.replace(horizon=horizon)
    satellites = world.equip(resolve_satellites(satellite))
    for name in world.prior_scale:
        known = {"*", *SATELLITES, *(s.name for s in satellites)}
        if name not in known:  # it would be passed over in silence
            raise unknown_name("satellite of prior_scale", name, known)
    return Problem(
        satellites=satellites,
        inertia=resolve_inertia(inertia),
        scenario=world,
        estimator=estimator_settings(world.estimator if estimator is None else estimator),
        reward=reward_settings(reward),
        include_covariance=include_covariance,
        control=control,
        observation=observation,
        include_walk=include_walk,
    )
