"""The problem an environment poses: satellites, inertia law, scenario, estimator, reward.

Both environments are built from one `Problem`, and the core's templates are built from it here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from satid_gym import sources
from satid_gym.config import Config, check_whole, unknown_name
from satid_gym.core.observation import layout
from satid_gym.core.records import draw_dtype, task_dtype
from satid_gym.disturbance import Disturbance
from satid_gym.estimators.belief import new_belief, state_size
from satid_gym.estimators.settings import (
    PARAMETER_COUNT,
    EstimatorSettings,
    Parameters,
    brief,
    estimator_settings,
    products_of_inertia,
)
from satid_gym.faults import Faults
from satid_gym.laws import INERTIA_MODES, TABLE, InertiaLaw, LawRanges
from satid_gym.plant import new_plant
from satid_gym.reward import CRITERIA, NUMBERS, RewardSettings, reward_settings
from satid_gym.satellite import SATELLITES, Satellite, inertia_tensor
from satid_gym.scenario import SCENARIOS, Scenario

SatelliteLike = str | Satellite | Mapping[str, Any] | Sequence[str | Satellite | Mapping[str, Any]]
InertiaLike = str | InertiaLaw | Mapping[str, Any]
ScenarioLike = str | Scenario | Mapping[str, Any]


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem(Config):
    """Everything that defines an environment, resolved and checked.

    Attributes:
        satellites: an episode draws one of them; all have the same number of wheels.
        inertia: "random", a mode whose law is drawn from the scenario's ranges, or one exact law.
        scenario: the world.
        estimator: tuning of the compiled filter; `parameters` that were left open are settled here: "full" where a
            satellite, the law or the scenario has products of inertia about the body axes, else "principal".
        reward: what pays.
        include_covariance: whether the filter's whole covariance is observed.

    Raises:
        ValueError: the satellites' wheels differ in number, or "principal" would leave out products of inertia.
    """

    satellites: tuple[Satellite, ...]
    inertia: str | InertiaLaw
    scenario: Scenario
    estimator: EstimatorSettings
    reward: RewardSettings
    include_covariance: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        counts = {s.wheels.count for s in self.satellites}
        if len(counts) != 1:
            raise ValueError(f"all satellites of an environment need the same number of wheels, got {sorted(counts)}")
        missed = self._products()
        if self.estimator.parameters is None:
            settled = self.estimator.replace(parameters="full" if missed else "principal")
            object.__setattr__(self, "estimator", settled)
        elif missed:
            self.check_parameters(missed)

    def _products(self) -> str:
        """What has products of inertia about the body axes, in words; "" where nothing has."""
        changes = self.inertia.changes if isinstance(self.inertia, InertiaLaw) else ()
        for satellite in self.satellites:
            moments = np.diag(satellite.inertia)
            if found := products_of_inertia(satellite.inertia, moments):
                return f"satellite {satellite.name!r} has products of inertia about the body axes, {found}"
            for change in changes:
                if found := products_of_inertia(change, moments):
                    return f"the inertia law's change has products of inertia about the body axes, {found}"
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
            raise ValueError(
                f'{missed}: a filter with parameters "principal" leaves products of inertia out and is far off without '
                f'saying so. Make the environment with estimator={{"name": "{self.estimator.name}", "parameters": '
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
    def layout(self) -> dict[str, slice]:
        """Places of the observation's parts by name, in order."""
        p = PARAMETER_COUNT[self.parameters]
        others = state_size(self.estimator, self.parameters, self.wheels) - p if self.include_covariance else 0
        return layout(self.wheels, p, others)


def problem(
    satellite: SatelliteLike = "microsat",
    inertia: InertiaLike = "random",
    scenario: ScenarioLike = "default",
    estimator: str | Mapping[str, Any] | EstimatorSettings | None = None,
    reward: str | Mapping[str, Any] | RewardSettings | None = None,
    max_episode_steps: int | None = None,
    include_covariance: bool = False,
) -> Problem:
    """Resolve what a user gave to `gymnasium.make`.

    Raises:
        ValueError: a name is unknown or a value is not valid.
    """
    world = resolve_scenario(scenario)
    if max_episode_steps is not None:
        steps = check_whole("max_episode_steps", max_episode_steps)
        world = world.replace(horizon=steps * world.decision_period)
    satellites = resolve_satellites(satellite)
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
    )


def resolve_satellites(satellite: SatelliteLike) -> tuple[Satellite, ...]:
    """The satellites that a name, a file, module:name, a satellite, a mapping or a list of these stands for.

    Raises:
        ValueError: a name is unknown or a value is not valid.
    """
    if isinstance(satellite, str) and satellite == "random":
        return tuple(SATELLITES.values())
    if isinstance(satellite, (str, Satellite, Mapping)):
        return (_satellite(satellite),)
    if not isinstance(satellite, Sequence) or not satellite:
        raise ValueError(
            "satellite must be a name, a file, module:name, a Satellite, a mapping or a list of these, "
            f"got {satellite!r}"
        )
    return tuple(_satellite(s) for s in satellite)


def _satellite(value: str | Satellite | Mapping[str, Any]) -> Satellite:
    if isinstance(value, Satellite):
        return value
    if isinstance(value, Mapping):
        return Satellite.from_dict(value)
    if isinstance(value, str) and value in SATELLITES:
        return SATELLITES[value]
    if not sources.is_source(value):
        raise sources.unknown("satellite", value, [*SATELLITES, "random"])
    return sources.load(value, Satellite, Satellite.from_dict)


def resolve_inertia(value: InertiaLike) -> str | InertiaLaw:
    """The law or mode that a name, a file, module:name, a law or a mapping stands for.

    Raises:
        ValueError: a name is unknown or a value is not valid.
    """
    if isinstance(value, InertiaLaw):
        return value
    if isinstance(value, Mapping):
        return InertiaLaw.from_dict(value)
    if isinstance(value, str) and value in ("random", *INERTIA_MODES):
        return value
    if not sources.is_source(value):
        raise sources.unknown("inertia mode", value, ["random", *INERTIA_MODES])
    return sources.load(value, InertiaLaw, InertiaLaw.from_dict)


def resolve_scenario(value: ScenarioLike) -> Scenario:
    """The scenario that a name, a file, module:name, a scenario or a mapping stands for.

    A mapping changes settings of the scenario that it names as its `base`, or else by its own name.

    Raises:
        ValueError: a name is unknown or a value is not valid.
    """
    if isinstance(value, Scenario):
        return value
    if isinstance(value, Mapping):
        return _changed_scenario(value)
    if isinstance(value, str) and value in SCENARIOS:
        return SCENARIOS[value]
    if not sources.is_source(value):
        raise sources.unknown("scenario", value, SCENARIOS)
    return sources.load(value, Scenario, _changed_scenario)


def _changed_scenario(value: Mapping[str, Any]) -> Scenario:
    changes = dict(value)
    base = changes.pop("base", changes.get("name", "default"))
    if isinstance(base, str) and base in SCENARIOS:
        return SCENARIOS[base].replace(**changes)
    if "base" in value:
        raise unknown_name("base of a scenario", base, SCENARIOS)
    return Scenario.from_dict(changes)


@dataclass(frozen=True)
class Templates:
    """The core's records, one row a satellite."""

    satellites: tuple[Satellite, ...]
    draws: np.ndarray
    plants: np.ndarray
    beliefs: np.ndarray
    tasks: np.ndarray

    @property
    def records(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What an episode starts as."""
        return self.plants, self.beliefs, self.tasks


def build_templates(p: Problem, inertia: np.ndarray | None = None, room: int = 1) -> Templates:
    """Templates of a problem, with room for so many knots or more; a true `inertia` replaces the drawn one.

    Raises:
        ValueError: `inertia` is no rigid body's, or has products that the problem's filter leaves out.
    """
    rows = [_template(p, satellite, inertia, room) for satellite in p.satellites]
    columns = zip(*rows, strict=True)
    draws, plants, beliefs, tasks = (np.concatenate(parts).view(parts[0].dtype) for parts in columns)
    tasks["template"] = np.arange(len(tasks))
    return Templates(p.satellites, draws, plants, beliefs, tasks)


def _template(p: Problem, satellite: Satellite, inertia: np.ndarray | None, room: int) -> tuple[np.ndarray, ...]:
    scenario = p.scenario
    operating = scenario.operate(satellite)
    law = p.inertia if isinstance(p.inertia, InertiaLaw) else None
    disturbance = Disturbance(
        gravity_gradient=scenario.gravity_gradient,
        solar_force=(scenario.solar_pressure, 0.0, 0.0),
        orbit_rate=scenario.orbit_rate,
    )
    true = operating if inertia is None else operating.replace(inertia=inertia_tensor(inertia, "true inertia"))
    if inertia is not None and (found := products_of_inertia(true.inertia, np.diag(true.inertia))):
        p.check_parameters(f"the true inertia has products of inertia about the body axes, {found}")
    plants = new_plant(true, law, disturbance, room)
    plant = plants[0]
    plant["torque_noise_std"] = scenario.torque_noise * operating.wheels.max_torque
    plant["torque_lag"] = scenario.torque_lag
    plant["gyro_noise_std"], plant["gyro_bias_walk"] = operating.gyro_noise_std, scenario.gyro_bias_walk
    plant["tachometer_noise_std"] = operating.tachometer_noise_std
    plant["outlier_probability"] = scenario.faults.gyro_outlier
    plant["outlier_size"] = np.multiply(operating.gyro_noise_std, scenario.faults.gyro_outlier_size)
    briefing = brief(satellite, scenario)
    beliefs = new_belief(briefing, p.estimator)
    tasks = _task(p, operating, briefing.inertia)
    draws = _draw(p, operating, law, room)
    if inertia is not None:
        draws["inertia_std"] = draws["tilt_std"] = 0.0
    return draws, plants, beliefs, tasks


def _task(p: Problem, satellite: Satellite, prior: np.ndarray) -> np.ndarray:
    scenario, reward = p.scenario, p.reward
    rows = np.zeros(1, task_dtype(satellite.wheels.count))
    task = rows[0]
    task["sample_period"], task["samples"] = scenario.sample_period, scenario.samples
    task["decisions"] = scenario.decisions
    task["torque_max"], task["wheel_speed_max"] = satellite.wheels.max_torque, satellite.wheels.max_speed
    task["rate_limit"] = satellite.rate_limit
    task["termination_rate"] = scenario.termination_factor * satellite.rate_limit
    full = np.abs(satellite.wheels.axes) @ satellite.wheels.max_torque
    task["authority"] = full * scenario.decision_period / np.diag(prior) / satellite.rate_limit
    stored = np.abs(satellite.wheels.axes) @ (satellite.wheels.inertia * satellite.wheels.max_speed)
    task["swing"] = np.diag(prior) * satellite.rate_limit / stored
    task["criterion"], task["net"] = CRITERIA.index(reward.criterion), reward.net
    for name in NUMBERS:
        task[name] = getattr(reward, name)
    return rows


def _draw(p: Problem, satellite: Satellite, law: InertiaLaw | None, room: int) -> np.ndarray:
    scenario = p.scenario
    rows = np.zeros(1, draw_dtype(max(room, law.room if law is not None else 1)))
    draw = rows[0]
    draw["inertia_std"], draw["tilt_std"] = scenario.inertia_std, scenario.tilt_std
    draw["wheel_speed_range"] = scenario.wheel_speed_range
    draw["rate_std"] = scenario.initial_rate_std * satellite.rate_limit
    draw["disturbance_std"] = satellite.disturbance_std
    draw["attitude_random"] = scenario.random_attitude
    if law is None:
        modes = INERTIA_MODES if p.inertia == "random" else (p.inertia,)
        draw["law_probability"] = [(mode in modes) / len(modes) for mode in INERTIA_MODES]
        _write_ranges(draw, scenario.laws, scenario.horizon)
    else:
        draw["law_probability"] = [mode == law.mode for mode in INERTIA_MODES]
        draw["law_size"], draw["law_time"] = law.size, law.time
        draw["law_frequency"], draw["law_phase"] = law.frequency, law.phase
        draw["change_given"] = not law.relative
        if law.mode == TABLE and law.relative:
            assert law.values is not None
            draw["knot_size"][: len(law.values)] = law.values - 1.0
    _write_faults(draw, scenario.faults, scenario.horizon)
    return rows


def _write_faults(draw: np.void, faults: Faults, horizon: float) -> None:
    draw["faulty"] = faults.possible
    draw["fault_time"] = [horizon * x for x in faults.time]
    draw["dropout_probability"], draw["dropout_silent"] = faults.gyro_dropout, faults.gyro_dropout_silent
    draw["dropout_duration"] = faults.gyro_dropout_duration
    draw["bias_std"] = faults.gyro_bias_std
    draw["stuck_probability"], draw["stuck_duration"] = faults.tachometer_stuck, faults.tachometer_stuck_duration
    draw["loss_probability"], draw["loss_size"] = faults.wheel_loss, faults.wheel_loss_size
    draw["torque_delay"] = faults.torque_delay


def _write_ranges(draw: np.void, laws: LawRanges, horizon: float) -> None:
    static, one = (0.0, 0.0), (horizon, horizon)
    draw["law_size"] = [static, laws.step_size, laws.drift_size, laws.periodic_size]
    draw["law_time"] = [one, [horizon * x for x in laws.step_time], one, one]
    draw["law_frequency"], draw["law_phase"] = laws.frequency, laws.phase
