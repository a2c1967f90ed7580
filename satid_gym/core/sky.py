"""Sky: what blinds a star tracker, and whether a payload is on its target; for the truth and for who plans ahead."""

from __future__ import annotations

from satid_gym.core.algebra import dot, load, norm
from satid_gym.core.jit import inline
from satid_gym.core.rotation import to_inertial


@inline
def is_blind(tracker, attitude, rate, phase):
    """Whether a tracker (`core.truth.star_tracker.tracker_dtype`) sees no stars.

    Args:
        tracker: record of its data sheet and of the Sun's direction.
        attitude: (4,) unit quaternion, body to inertial.
        rate: body rate, rad/s.
        phase: cosine and sine of the orbit's angle; the Earth is at (cosine, sine, 0).
    """
    boresight = to_inertial(attitude, load(tracker.boresight))
    blinded = dot(boresight, load(tracker.sun)) > tracker.sun_cosine
    blinded = blinded or dot(boresight, (phase[0], phase[1], 0.0)) > tracker.earth_cosine
    return blinded or norm(rate) > tracker.rate_limit


@inline
def is_off_target(boresight, target, rate, pointing_cosine, steadiness):
    """Whether a payload is farther from its target than a window allows, or the body not steady.

    Args:
        boresight: unit vector, inertial frame.
        target: likewise.
        rate: body rate, rad/s.
        pointing_cosine: of the largest angle between the two.
        steadiness: largest body rate, rad/s.
    """
    return dot(boresight, target) < pointing_cosine or norm(rate) > steadiness
