"""SatInertiaID-v0, the single environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from satid_gym.config import check_integer, unknown_name
from satid_gym.core.observation import Form
from satid_gym.estimators.protocol import Estimator, is_estimator
from satid_gym.estimators.settings import EstimatorSettings
from satid_gym.fleet import Fleet
from satid_gym.gym_api import info_of, make_spaces, option_templates, real_action, seed_stream
from satid_gym.plugin_estimator import PluginFilter, plugin_settings
from satid_gym.problem import problem
from satid_gym.resolution import InertiaLike, SatelliteLike, ScenarioLike
from satid_gym.reward import RewardSettings
from satid_gym.satellite import Satellite
from satid_gym.scenario import prior_of
from satid_gym.truth.choice import truth_of
from satid_gym.truth.driver import TruthDriver
from satid_gym.truth.protocol import Truth

if TYPE_CHECKING:
    from satid_gym.rendering import History


class SatInertiaIDEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """A satellite with reaction wheels identifies its own time-varying inertia by the torques it chooses.

    ## Description
    The truth is a body with n >= 3 reaction wheels under torque and speed limits, external torque and noise, and with
    panels and slosh masses where the satellite has them; its inertia is static, steps, drifts, oscillates, or changes
    as a mass is moved, used up or released. An extended Kalman filter estimates the inertia from gyro, wheel speeds and
    a star tracker where there is one. The agent chooses wheel torque so that the filter learns as much as possible
    while the body rates stay within the operating envelope. One decision a second, sensors and filter at
    10 Hz, 300 s.

    ## Action space
    `Box(-1, 1, (n,), float32)`: motor torque on each wheel as a fraction of its limit, held for a decision. The body
    feels the opposite. Values beyond are clipped; NaN or another shape raise ValueError.

    `control="rate"`: `Box(-1, 1, (3,), float32)`, the body rate to fly as a fraction of the rate limit, about each body
    axis. A rate loop in the environment turns it into torque, sample by sample, on the filter's estimate of the
    inertia. The rate scatters about the reference, so with an action of 1 it exceeds the limit half of the time; `info`
    and costs are the same, and the observation's `command` is the action, 3 numbers in both forms.

    ## Observation space
    `Box(-10, 10, (16 + 2 n + 5 p,), float32)`: belief and measurement only, 37 numbers for three wheels and p = 3
    moments of inertia; p = 6 where a satellite, the law or the scenario has products of inertia. `env.unwrapped.layout`
    gives the slices by name. `include_covariance=True` appends the last two parts, with which all of the filter's
    covariance is observed (70 numbers). Its s states are momentum, parameters, disturbance torque (MomentumEKF,
    adaptive or not, s = p + 6) or rate, parameters, wheel speeds (RateEKF, s = p + 3 + n). `include_walk=True` puts one
    number before these two parts, `inertia_walk`: log10(the filter's random walk of each moment / its scale, per
    sqrt(s)) + 2; -10 where it is 0.

    | name | size | meaning |
    |---|---|---|
    | rate | 3 | gyro reading / rate limit |
    | wheel_speed | n | tachometer reading / wheel speed limit |
    | inertia | p | (estimate - prior mean) / scale; scale: prior moments, for products their geometric means |
    | uncertainty | p | log10(filter's std / scale) + 2 |
    | disturbance | 3 | estimated disturbance torque / its prior std |
    | correlation | 3 p | filter's correlation of each momentum (rate) component with each parameter |
    | control_authority | 3 | change of the rate by a decision of full torque / rate limit, by prior inertia |
    | momentum_fraction | 3 | share of the wheels' momentum that turning at the rate limit takes, by prior inertia |
    | coast_rate_change | 3 | predicted change of the rate in a decision without command / rate limit, by the belief |
    | command | n | previous action; 3 under control="rate" |
    | time_left | 1 | fraction of the horizon |
    | state_uncertainty | s - p | log10(filter's std / scale) + 2 of the other states; scale: prior moment times rate \
limit for momentum, prior std for torque, limits for rate and wheel speeds; -10 where it is 0 |
    | state_correlation | s (s - 1) / 2 - 3 p | upper triangle, row by row, of the correlation matrix of the states, \
without the 3 x p block that `correlation` holds |

    ## Observation in the body frame
    `observation="body"`: `Box(-10, 10, (25 + 5 p + 17 m,), float32)` for a filter that estimates m modes of panels and
    slosh, 40 numbers for p = 3 and m = 0. The wheels' effect on the body replaces the state of each wheel, so that size
    and meaning do not depend on the number of wheels (except for the last two parts, with the RateEKF or tolerances of
    the wheels). The first three parts below take the places of `wheel_speed` and `command`, the others follow
    `time_left`; all other parts are as above. A are the wheels' axes (3, n), j their inertia.

    | name | size | meaning |
    |---|---|---|
    | wheel_momentum | 3 | A j Omega by the tachometers / the largest that the wheels can store along each axis, \
abs(A) j Omega_max |
    | fastest_wheel | 2 | largest wheel speed / its limit: now, and the largest possible while each rate is within its \
limit, by the belief and least-norm wheel momentum; above 1 a wheel may saturate |
    | command | 3 | previous action as torque on the body, -A u, / the largest that the wheels can give along each \
axis, abs(A) u_max; under control="rate" the action |
    | nis | 1 | log10 of the decision's mean normalised innovation squared, per degree of freedom: about 0 when \
consistent, and 0 without an update |
    | modes | 17 m | for each mode, the numbers of the next table |
    | null_momentum | 1 | momentum of more than three wheels in the null space of their axes, along the direction of \
the null motion, by the tachometers / the largest that a wheel can store; only if they avoid a band of speed |

    ## Modes in the observation
    eta is the mode's deflection, d its coupling, w its frequency in rad/s, zeta its damping ratio, as in
    `satid_gym.modes.Mode`. With `include_covariance=True` the scales of eta and its momentum are those of the first two
    numbers, those of errors of sensors and wheels their prior std; the logarithms of w, abs(d) and zeta are not scaled.

    | name | size | meaning |
    |---|---|---|
    | deflection | 1 | eta / (abs(d) rate limit / w) by nominal d and w: a step of the body rate by its limit about \
the axis of d oscillates up to 1, a reversal up to 2 |
    | deflection_rate | 1 | deta/dt / (abs(d) rate limit) by nominal d |
    | deflection_limit | 1 | the mode's limit, scaled as `deflection`; 10 where it is larger, or without a limit |
    | frequency | 1 | w / (2 pi) times the decision period: oscillations in a decision with the body held still |
    | frequency_std | 1 | log10(filter's std of log w) + 2; -10 where it is 0 |
    | coupling | 3 | d_i / sqrt(J_ii) by the belief: the square is the mode's share of axis i's inertia |
    | coupling_std | 1 | log10(filter's std of log abs(d)) + 2; -10 where it is 0 |
    | damping | 1 | log10(zeta) + 2; -10 where it is 0 |
    | damping_std | 1 | log10(filter's std of log zeta) + 2; -10 where it is 0 |
    | centrifugal | 6 | xx, yy, zz, xy, xz, yz of a matrix K: constant body rates r, over their limit, bend the mode \
to r . K r, in the unit of `deflection` |

    ## Attitude in the observation
    With a star tracker both forms have these after the parts above, before those of `include_covariance`, in which the
    scale of an attitude error is 1 rad.

    | name | size | meaning |
    |---|---|---|
    | attitude_uncertainty | 3 | log10(filter's std of the attitude error about each body axis, rad) + 2; 2 where \
the attitude is not known |
    | attitude_age | 1 | time since the tracker's last reading that was used / decision period, or since the start \
before the first; at most 10 |
    | sun | 3 | direction of the Sun in the body frame, by the ephemeris and the estimated attitude; 0 where the \
attitude is not known. Only if the Sun blinds the tracker, or the scenario has operations |
    | earth | 3 | likewise for the Earth's centre; only if the Earth blinds the tracker |
    | window | 2 | time to the opening and to the closing of the imaging window that is open or comes next / 60 s; the \
first is negative while it is open. This and the next only if the scenario has operations |
    | target | 3 | rotation vector that brings the payload's boresight to that window's target, body frame, rad: the \
smallest rotation, by the estimated attitude; 0 where that is not known |

    ## Reward
    gain_scale gained + held_scale (held - held_reference)
    - envelope_weight excess - saturation_weight saturated - deflection_weight bent
    - avoided_band_weight in_band - effort_weight effort

    | term | default weight | meaning |
    |---|---|---|
    | gained | 0 | sum over the decision's filter updates of 1/2 log(det P before / det P after), P the \
covariance of the inertia parameters, in nats; never negative, except where the adaptive filter finds a step or \
`inflate` raises the covariance |
    | held | 0.1 | nats by which the inertia is better known at the decision's end than before launch: \
1/2 log(det P before launch / det P) |
    | excess | 10 | sum over axes of the largest measured rate of the decision (the filter's where it accepts none) \
over the rate limit, less 1, where positive |
    | saturated | 1 | share of the wheels that were at their speed limit in the decision |
    | bent | 10 | largest deflection that the filter estimates in the decision over its limit, less 1, where positive |
    | in_band | 10 | share of the decision's samples at which a tachometer reads a speed in the band to avoid |
    | effort | 0 | mean square of the torque over its limit, 0 to 1 |

    `reward={"criterion": "trace" or "maxeig"}` uses A- or E-optimality, `{"net": True}` makes the gain the change over
    the decision instead of the sum; see `RewardSettings`. No term depends on the truth. The gain of updates grows with
    what the filter forgets between them, and a policy can make the adaptive filter forget; therefore the default pays
    for the information held.

    ## Starting state
    True moments lognormal (15 %) about nominal, filter's prior at nominal (30 %); wheels uniform within 20 %
    of their limit; body nearly at rest; random attitude; disturbance constant and orbit-periodic, unknown.
    Inertia law drawn from the paper's four modes with random size and timing.

    ## Episode end
    Terminated when a true body rate exceeds three times the rate limit, or a deflection four times its limit.
    Truncated after 300 decisions, by the environment itself.

    ## Information
    Truth appears here and only here, for evaluation.

    | key | meaning |
    |---|---|
    | time | s |
    | inertia_true, inertia_estimate | (3, 3) kg m^2 |
    | relative_error | Frobenius norm of their difference over that of the truth |
    | nees | normalised estimation error squared of the parameters, per degree of freedom; about 1 when consistent |
    | nis | normalised innovation squared of the last update, per degree of freedom |
    | information_gain, information_held | nats of this decision, and since before launch |
    | outside | share of the decision's samples with a true rate outside the limit |
    | costs | each from 0 to 1, by name: "rate": `outside`; "saturation": share of the wheels that were at their speed \
limit; "deflection": share of the samples with a panel or a slosh mass beyond its limit; "avoided_band": \
`in_avoided_band`; "window": share of the samples in an open imaging window with the payload off its target or not \
steady; "keep_out": share of the samples with the payload looking too near the Sun |
    | cost | the largest of them; Safety-Gymnasium's one cost is the sum of its costs |
    | effort | mean square of the torque over its limit |
    | in_avoided_band | share of the decision's samples with a wheel's speed in the band that operators avoid |
    | tracking | share of the decision's samples at which the star tracker sees its stars; 0 without one |
    | saturated | (n,) whether a wheel was at its speed limit |
    | torque_applied | (n,) mean motor torque less friction, N m |
    | constrained_updates | filter updates shortened so far to keep the estimate positive definite |
    | rejected | readings of gyro and star tracker that the filter has rejected so far |
    | nis_mean | mean normalised innovation squared of the last 1000 updates, per degree of freedom; about 1 when \
consistent, and 1 where the filter is not monitored (RateEKF, own estimators) |
    | colour | largest variance of smoothed innovations, relative to white noise and to its limit; above 1 it is an \
alarm |
    | unmodelled | whether the innovations are larger or more coloured than those of a consistent filter, or the \
estimate of a mode is far from its data sheet; a periodic inertia can cause it too |
    | inflation | factor on the variance of the readings' noise, with the estimator's `inflate`; else 1 |
    | restarts | times that the filter, where it estimates modes, has restarted after an early alarm or an estimate \
of a mode far from its data sheet |
    | inertia_walk | the filter's random walk of each moment relative to its prior, per sqrt(s) |
    | steps_found | steps of the inertia that the filter has found so far |
    | faults | (5,) whether a fault acted in the decision, in the order of `satid_gym.faults.FAULTS` |
    | deflection | (c,) largest deflection of each panel, rad, and slosh mass, m; (0,) without any |

    ## Arguments
    Each takes a name, a mapping of plain values, or the dataclass behind it; satellite, inertia and scenario also the
    path of a .json or .toml file, or "module:name", whose code is run.

    | argument | default | values |
    |---|---|---|
    | satellite | "microsat" | "cubesat", "microsat", "smallsat", "innocube", "random", a `Satellite`, or a list to \
draw from |
    | inertia | "random" | "static", "step", "drift", "periodic", "random" (one of these four), "deployment", "fuel", \
"release", or an `InertiaLaw` |
    | scenario | "default" | "default", "tight" (a tenth of the wheel momentum), "faults", "flex" (panels), "slosh" \
(a tank), "calibration" (a star tracker), "operations" (imaging windows), "wheels4" (speeds to \
avoid), "paper", or a `Scenario` |
    | estimator | None | "adaptive", "momentum", "rate", their settings, or any object that follows `Estimator`; \
None takes the scenario's |
    | reward | defaults | `RewardSettings`, or the name of a criterion |
    | max_episode_steps | 300 | horizon in decisions; `gymnasium.make` uses it only for its TimeLimit, which does not \
change the horizon; there give `scenario={"horizon": seconds}`, and not both |
    | render_mode | None | "rgb_array"; through `gymnasium.make` also "human" |
    | render_size | 480 | width and height of a frame in pixels, 240 to 2160 |
    | include_covariance | False | whether the filter's whole covariance is observed |
    | control | "torque" | what an action is: "torque" of each wheel, or the body "rate" that the rate loop tracks |
    | observation | "wheels" | "wheels": the state of each wheel; or "body": their effect on the body, NIS and modes |
    | include_walk | False | whether the filter's random walk of the inertia is observed |
    | truth | None | None: the environment's own truth; or an object that follows `satid_gym.truth.Truth`, such as \
another simulator, or its module:name |

    `reset(options=...)` takes `satellite`, `inertia` and `true_inertia` for one episode.

    ## Rendering
    `render()` gives a picture (render_size, render_size, 3) of the episode so far, for people only, since it shows the
    truth. It needs pygame, `pip install "satid-gym[render]"`, and does not change the episode.

    ## Version history
    - v0: first version.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}

    def __init__(
        self,
        satellite: SatelliteLike = "microsat",
        inertia: InertiaLike = "random",
        scenario: ScenarioLike = "default",
        estimator: str | Mapping[str, Any] | EstimatorSettings | Estimator | None = None,
        reward: str | Mapping[str, Any] | RewardSettings | None = None,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        render_size: int = 480,
        include_covariance: bool = False,
        control: str = "torque",
        observation: Form = "wheels",
        include_walk: bool = False,
        truth: str | Truth | None = None,
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise unknown_name("render mode", render_mode, self.metadata["render_modes"])
        self.render_mode = render_mode
        self.render_size = check_integer("render_size", render_size, low=240, high=2160)
        self._history: History | None = None
        if render_mode is not None:
            import satid_gym.rendering  # noqa: F401  # say now, not in mid-episode, that pygame is missing
        settings: Any = plugin_settings(estimator) if is_estimator(estimator) else estimator
        self.problem = problem(
            satellite,
            inertia,
            scenario,
            settings,
            reward,
            max_episode_steps,
            include_covariance,
            control,
            observation,
            include_walk,
        )
        self.fleet = Fleet(self.problem, 1)
        self.observation_space, self.action_space = make_spaces(self.problem)
        self._truth = None if truth is None else TruthDriver(truth_of(truth), self.fleet)
        sample = None if self._truth is None else self._truth.sample
        self._plugin = PluginFilter(estimator, self.fleet, sample) if is_estimator(estimator) else None

    @property
    def layout(self) -> dict[str, slice]:
        """Places of the observation's parts by name."""
        return self.problem.layout

    @property
    def _started(self) -> bool:
        """Whether the random stream was, which is with the first reset."""
        return bool(self.fleet.rows.plants["stream"].any())

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode.

        Args:
            seed: makes this episode reproducible and, with the same actions, those that follow.
            options: for this episode alone: `satellite`, `inertia` (mode, law or mapping), `true_inertia`
                ((3,) or (3, 3) kg m^2 in place of a drawn one).

        Returns:
            Observation and info.

        Raises:
            ValueError: an option is unknown or not valid; the episode under way goes on. Or a truth refuses the
                episode.
        """
        templates = option_templates(self.problem, options) if options else self.fleet.templates
        super().reset(seed=seed)
        rows = self.fleet.rows
        if seed is not None or not self._started:
            rows.plants["stream"][0] = seed_stream(self.np_random)
        if self._truth is None:
            self.fleet.begin(templates=templates.records)
        else:
            self._truth.begin(templates)
        satellite = templates.satellites[int(rows.tasks["template"][0])]
        if self._plugin is not None:
            self._plugin.start(prior_of(satellite, self.problem.scenario, self.problem.parameters))
        if self.render_mode is not None:
            self._start_history(satellite)
        return rows.observations[0].copy(), info_of(rows.reports)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Take one decision.

        Args:
            action: (n,) motor torque, or (3,) body rate, as fraction of the limit; cut to [-1, 1].

        Returns:
            Observation, reward, terminated, truncated, info.

        Raises:
            ValueError: the action is not finite or has another shape, and nothing has changed; or a truth of your own
                returned an invalid answer, and the episode is over.
            gymnasium.error.ResetNeeded: the episode is over or was never started.
            FloatingPointError: the filter broke down.
        """
        action = real_action("action", action)
        if action.shape != self.action_space.shape:
            raise ValueError(f"action must have shape {self.action_space.shape}, got {action.shape}")
        if not np.isfinite(action).all():
            raise ValueError(f"action must be finite, got {action.tolist()}")
        rows = self.fleet.rows
        if rows.tasks["over"][0]:
            why = "the episode is over" if self._started else "no episode was started"
            raise gymnasium.error.ResetNeeded(f"{why}: call reset() before step()")
        if self._plugin is not None:
            self._plugin.decide(action)
        elif self._truth is not None:
            self._truth.decide(action)
        else:
            self.fleet.step(action[None])
        report = rows.reports[0]
        if self._history is not None:
            self._history.note(rows.plants[0], rows.beliefs[0], report)
        return (
            rows.observations[0].copy(),
            float(report["reward"]),
            bool(report["terminated"]),
            bool(report["truncated"]),
            info_of(rows.reports),
        )

    def render(self) -> np.ndarray | None:  # type: ignore[override]
        """The episode so far as a picture, (render_size, render_size, 3) uint8; None without a render mode.

        Raises:
            gymnasium.error.ResetNeeded: no episode was started.
            ValueError: a truth of your own does not tell its inertia.
        """
        if self.render_mode is None:
            gymnasium.logger.warn('render() shows nothing without a render mode; make it with render_mode="rgb_array"')
            return None
        if self._history is None:
            raise gymnasium.error.ResetNeeded("there is nothing to show yet: call reset() before render()")
        if np.isnan(self._history.truth).any():
            raise ValueError("a picture shows the true inertia, and this truth does not tell it: leave out render_mode")
        from satid_gym.rendering import draw

        return draw(self._history, self.render_size)

    def _start_history(self, satellite: Satellite) -> None:
        from satid_gym.rendering import History

        scenario, rows = self.problem.scenario, self.fleet.rows
        law = int(rows.plants["law"][0])
        self._history = History(
            scenario.operate(satellite),
            scenario.decisions,
            scenario.decision_period,
            law,
            scenario.orbit_rate,
            scenario.operations,
        )
        self._history.note(rows.plants[0], rows.beliefs[0], rows.reports[0])
