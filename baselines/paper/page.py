"""Markdown page of the study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from baselines.command.markdown import table as markdown_table
from baselines.paper.exceedance import WIDER_PRIOR, Exceedance
from baselines.paper.figures.style import TITLES
from baselines.paper.methods import METHODS
from baselines.paper.study import HORIZON, HORIZONS, PLANTS, EpisodeScore
from baselines.paper.summary import MODES, CellScore, Check
from baselines.paper.tables import condition_table, dynamic_table, number, record_table, static_table
from baselines.paper.world import prior, scenario
from satid_gym.laws import paper_law
from satid_gym.plants import law_inertia
from satid_gym.satellite import BENCHMARK_SATELLITES


def page(
    found: Sequence[CellScore],
    horizon_runs: Sequence[EpisodeScore],
    checks: Sequence[Check],
    exceedances: Sequence[Exceedance],
    provenance: Mapping[str, Any],
) -> str:
    """Page with all tables; its figures are files in the same folder."""
    parts = [
        "# The paper's study, rerun",
        "El Hariry, Franzese, Olivares-Mendez, *Towards Active Excitation-Based Dynamic Inertia Identification in "
        "Satellites*, arXiv 2510.16738. All errors are relative errors of the inertia in %, mean ± standard "
        f"deviation over {provenance['seeds']['count']} seeds; the best of each group of columns is bold. "
        f"`{provenance['command']}`, revision {provenance['revision']}.",
        "## Checks",
        markdown_table(
            ["claim", "found", "met"],
            [[check.claim, check.found, "yes" if check.met else "**no**"] for check in checks],
            3,
        ),
        _exceptions(checks, exceedances),
        "## The world",
        _world(),
        "![The eight torque profiles](profiles.png)",
        "![From command to estimate](pipeline.png)",
        "## Static inertia",
        "Error at the end of the flight.",
        static_table(found),
        "![Static errors](static.png)",
        _static_notes(found),
        condition_table(found),
        "## Time-varying inertia",
        "Mean error over the last 20 % of the flight, against the varying truth.",
        _dynamic_notes(found),
        "### The plant truly varies",
    ]
    parts += [f"{TITLES[s]}\n\n{dynamic_table(found, s, 'varying')}" for s in BENCHMARK_SATELLITES]
    parts += [
        "![Dynamic errors, varying plant](dynamic_varying.png)",
    ]
    parts += [
        "Mean error over the whole flight, first seconds included, averaged over profiles; the smoother knows the "
        "future:",
        record_table(found),
        "### The plant stays constant",
    ]
    parts += [f"{TITLES[s]}\n\n{dynamic_table(found, s, 'constant')}" for s in BENCHMARK_SATELLITES]
    parts += [
        "![Dynamic errors, constant plant](dynamic_constant.png)",
        "## Length of the record",
        _horizon(horizon_runs),
        "![Error against the length of the record](horizon.png)",
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _exceptions(checks: Sequence[Check], exceedances: Sequence[Exceedance]) -> str:
    lines = [f"- {check.claim}: except {', '.join(check.exceptions)}." for check in checks if check.exceptions]
    lines += [
        f"- EKF, {TITLES[e.satellite]} {TITLES[e.profile]}: {number(e.ours)} % here, {number(e.paper)} % in the paper. "
        f"The first guess is up to {e.guess_off:.1f} prior standard deviations off (1 kg m²), and what remains of "
        f"that at the end is the error: with a prior of {WIDER_PRIOR:g} kg m² the same filter on the same readings "
        f"has an error of {number(e.wider_prior)} %."
        for e in exceedances
    ]
    return "\n".join(lines)


def _world() -> str:
    world = scenario()
    known = prior("smallsat")
    return (
        f'Scenario "paper" of the environment: readings and decisions every {world.decision_period:g} s for '
        f"{world.horizon:g} s, from rest; gyro noise {world.gyro_noise_std:g} rad/s with a bias walk of "
        f"{world.gyro_bias_walk:g} rad/s per √s; wheel speeds without noise; motors with a lag of "
        f"{world.torque_lag:g} s and 5 % torque noise, new every second; torque and speed limits; solar pressure; "
        "the paper's eight profiles at the paper's amplitudes, cut to the wheels' limits. The dynamics are the "
        "environment's, which conserve momentum exactly. The noise is added behind the motors' lag in the authors' "
        f"public code and before it here, so its setting is {100.0 * world.torque_noise:.2f} % to come out at 5 %.\n\n"
        "LS and EKF are the paper's: central differences, Huber loss, bounded trust region, with the wheel "
        "acceleration over the second before each reading; Euler step and the paper's noise settings, starting "
        "from 0.80 (CubeSat) or 0.85 of the truth. Neither knows the solar torque, 1e-8 N m, which is far "
        "below what either resolves.\n\n"
        "Ours see the same readings. Momentum LS and output error assume a constant inertia and the conservation "
        "of momentum, and differentiate nothing. MomentumEKF has its default inertia walk (0.4 % per √s), two "
        "midpoint steps a second, the prior of the environment (30 % about the same first guess), and from data "
        f"sheets a gyro noise of {known.gyro_noise_std:g} rad/s (white noise and the bias walked up in 300 s) and "
        f"a disturbance of {known.disturbance_std:g} N m (solar pressure on its 1 cm arm). RTS is its smoother, "
        "which at the end of the flight knows no more than the filter and before it knows the future as well."
    )


_ALIKE = ("varying", "static", "ls_alike")


def _static_notes(found: Sequence[CellScore]) -> str:
    alike = [cell.mean for cell in found if (cell.plant, cell.inertia_mode, cell.method) == _ALIKE]
    return (
        "The LS error is truncation: the central difference of the rates spans two seconds, the wheel acceleration "
        "one, and in between the torque noise and the steps of the profile change the acceleration. Measured: with "
        "the wheel speeds differenced as the rates are, the same LS on the same readings has errors of "
        f"{number(min(alike))} to {number(max(alike))} % in the 24 cells. Momentum LS has no such term. "
        "Starting at rest the total momentum is zero but for 1e-8 N m of solar torque, so J ω = −A j Ω at every "
        "reading, and any reading with a rate well above 1e-6 rad/s identifies the inertia: in this setting the "
        "profile hardly matters to an estimator that uses momentum. MomentumEKF allows for an inertia that varies, "
        "so its error at the end is that of the last seconds: it is largest where the profile ends at a zero of "
        "the rate (sine, sine 3-axis). RTS equals the filter at the end, by definition; what it adds is below.\n\n"
        "Condition numbers of the regressions (static), and how much of the "
        "wheels' time is at their speed limit:"
    )


def _dynamic_notes(found: Sequence[CellScore]) -> str:
    """Comparison of each plant's LS and EKF columns with the published ones."""
    rows = []
    for plant in PLANTS:
        for method in ("ls", "ekf"):
            ratio = [
                abs(cell.mean / cell.paper - 1.0)
                for cell in found
                if (cell.plant, cell.method) == (plant, method)
                and cell.inertia_mode in MODES
                and cell.horizon == HORIZON
                and cell.paper is not None
            ]
            rows.append([plant, METHODS[method], f"{np.median(ratio):.3f}", f"{sum(r <= 0.15 for r in ratio)}"])
    held = []
    for mode in MODES:
        time = np.arange(0.0, HORIZON + 0.5)
        factor = law_inertia(paper_law(mode, HORIZON), np.ones(3), time)[:, 0, 0]
        held.append(f"{100.0 * np.mean(np.abs(1.0 / factor - 1.0)[-round(0.2 * HORIZON) :]):.2f} % ({mode})")
    ours = [c for c in found if c.method == "momentum_ekf" and c.plant == "varying" and c.inertia_mode in MODES]
    largest = max(cell.mean for cell in ours)
    fixed = ("ls", "momentum_ls", "output_error")
    constant = max(c.mean for c in found if c.method in fixed and c.plant == "varying" and c.inertia_mode in MODES)
    return (
        "The experiment is run twice. With a plant that truly varies, as the paper describes it; and with a plant "
        "whose inertia stays at its first value while the error is taken against the varying truth. An estimator "
        f"that knows the first inertia perfectly then scores {', '.join(held)}. The published LS column is "
        "consistent with the second; the EKF column is nearer to it as well, though less clearly. Median relative "
        "distance of our columns from the published ones, and cells of 72 within 15 %:\n\n"
        + markdown_table(["plant", "estimator", "median distance", "within 15 %"], rows, 2)
        + "\n\nThe varying plant is therefore another, harder experiment than the published one, and its columns "
        "are not to be read against the paper's cell by cell. LS, momentum LS and output error assume a constant "
        f"inertia and miss by up to {number(constant)} %; the paper's EKF lags, since its assumed noises let it "
        f"follow only slowly. MomentumEKF follows: its largest error in the 72 cells is {number(largest)} %. One "
        "step is no exception here: after the step the wheels keep their momentum and the body keeps turning, at "
        "more than 0.1 rad/s, so every reading goes on identifying the inertia."
    )


def _horizon(runs: Sequence[EpisodeScore]) -> str:
    lost = [
        f"{sum(np.isnan(r.error) for r in group)} of {len(group)} at {horizon:g} s"
        for horizon in HORIZONS
        if (group := [r for r in runs if r.method == "ls" and r.horizon == horizon and r.inertia_mode == "static"])
        and any(np.isnan(r.error) for r in group)
    ]
    return (
        "Static inertia, a new flight for each horizon, error at its end: mean over profiles and seeds, band from the "
        "10th to the 90th percentile. MomentumEKF's error at the end depends on how fast the body turns in the "
        "last seconds, hence its ups and downs; batch estimators average over the record."
        + (f" Records in which LS could not identify an axis are left out: {', '.join(lost)}." if lost else "")
    )
