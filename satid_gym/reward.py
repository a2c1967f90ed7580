"""Settings of the reward."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from satid_gym.config import Config, check_number

Criterion = Literal["logdet", "trace", "maxeig"]
NUMBERS = (
    "gain_scale",
    "held_scale",
    "held_reference",
    "envelope_weight",
    "envelope_margin",
    "saturation_weight",
    "deflection_weight",
    "avoided_band_weight",
    "effort_weight",
)


@dataclass(frozen=True, eq=False, kw_only=True)
class RewardSettings(Config):
    """Weights of the reward.

    gain_scale gained + held_scale (held - held_reference)
    - envelope_weight excess - saturation_weight saturated - deflection_weight bent
    - avoided_band_weight in_band - effort_weight effort

    Attributes:
        criterion: measure of the information on theta, in nats: "logdet" (D-optimality), "trace" (A), "maxeig" (E).
        net: False sums the gain of each filter update; True takes the change over the decision, which the filter's own
            forgetting reduces.
        gain_scale: reward for each nat gained.
        held_scale: reward for each nat by which theta is better known at the decision's end than before launch.
        held_reference: nats held at which that reward is zero, to keep returns small.
        envelope_weight: penalty for a unit of excess: the largest measured rate of the decision over the rate
            limit, less the margin, where positive, summed over axes. Where the filter rejects a reading or gets
            none, its own estimate of the rate takes the reading's place.
        envelope_margin: fraction of the rate limit at which the penalty begins. Below 1 it is paid inside the envelope
            too, and the reward no longer ranks policies as their errors do.
        saturation_weight: penalty for the share of the wheels that were at their speed limit in the decision.
        deflection_weight: penalty for a unit of the largest deflection that the filter estimates in the decision, over
            its limit, less 1, where positive.
        avoided_band_weight: penalty for the share of the decision's samples at which a tachometer reads a speed in the
            band that operators avoid.
        effort_weight: penalty for the mean square of the torque over its limit.

    Raises:
        ValueError: the criterion is unknown or a number is negative.
    """

    criterion: Criterion = "logdet"
    net: bool = False
    gain_scale: float = 0.0
    held_scale: float = 0.1
    held_reference: float = 0.0
    envelope_weight: float = 10.0
    envelope_margin: float = 1.0
    saturation_weight: float = 1.0
    deflection_weight: float = 10.0
    avoided_band_weight: float = 10.0
    effort_weight: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in NUMBERS:
            check_number(name, getattr(self, name))


def reward_settings(value: str | Mapping[str, Any] | RewardSettings | None) -> RewardSettings:
    """Settings from None (defaults), the name of a criterion, a mapping, or themselves."""
    if value is None:
        return RewardSettings()
    if isinstance(value, str):
        return RewardSettings(criterion=value)  # type: ignore[arg-type]
    if isinstance(value, RewardSettings):
        return value
    if not isinstance(value, Mapping):
        raise ValueError(f"reward must be the name of a criterion, a mapping or RewardSettings, got {value!r}")
    return RewardSettings.from_dict(value)
