"""Choice of the policy that is flown, by a name, a path or module:name."""

from __future__ import annotations

from pathlib import Path

from satid_gym.config import unknown_name
from satid_gym.manoeuvres.policy import ManoeuvrePolicy
from satid_gym.policies import BASELINES, RATE_BASELINES, make_baseline, names
from satid_gym.policies.custom import find_any
from satid_gym.policies.learned.shipped import rate_names
from satid_gym.policies.rate_square import RateSquarePolicy, untuned_rate_square
from satid_gym.policies.registry import NotPreparedError
from satid_gym.policy import Policy
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario


def check_control(name: str, control: str) -> None:
    """Check on a command line that a named policy that commands body rates alone gets them.

    Raises:
        ValueError: the control is by torque.
    """
    if control != "rate" and (name in RATE_BASELINES or name in rate_names()):
        raise ValueError(f"{name} commands body rates: add --control rate")


def policy_by_name(name: str, satellite: Satellite, scenario: Scenario) -> Policy:
    """Policy by name, path, module:name or the path of a design.json; rate_square for any satellite, tuned or not.

    Raises:
        ValueError: no policy has that name, or another baseline is not tuned for the satellite.
    """
    if name.endswith(".json") and not Path(name).with_suffix(".safetensors").exists():
        return ManoeuvrePolicy.read(Path(name))
    baselines = {**BASELINES, **RATE_BASELINES}
    if name in baselines and name not in names():
        try:
            return make_baseline(name, satellite.name, scenario.name)
        except NotPreparedError as error:
            if name == RateSquarePolicy.name:
                return untuned_rate_square(satellite, scenario.horizon)
            raise ValueError(
                f'{error}; rate_square, with control="rate" (satid: --control rate), flies any satellite'
            ) from error
    try:
        return find_any(name)
    except ValueError as error:
        if isinstance(error.__cause__, FileNotFoundError):  # the baselines are names, too
            raise unknown_name("policy (no such file either)", name, [*names(), *rate_names(), *baselines]) from error
        raise
