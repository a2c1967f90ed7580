"""Words for the end of an episode that ends early."""

from __future__ import annotations

from satid_gym.env import SatInertiaIDEnv


def early_end(env: SatInertiaIDEnv) -> str:
    """Time and cause of the early end that the environment's episode has just had, such as a rate far too high."""
    rows = env.fleet.rows
    task, plant, report = rows.tasks[0], rows.plants[0], rows.reports[0]
    factor = task["termination_rate"] / task["rate_limit"]
    cause = f"a body rate beyond {factor:g} times its limit"
    if abs(plant["rate"]).max() <= task["termination_rate"]:
        beyond = report["deflection"] > task["termination_deflection"]
        factor = (task["termination_deflection"][beyond] / task["deflection_limit"][beyond]).max()
        cause = f"a deflection beyond {factor:g} times its limit"
    return f"ended at {report['time']:g} s: {cause}"
