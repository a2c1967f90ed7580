"""Inertia of rigid bodies: what is one, and parts of a satellite."""

from __future__ import annotations

import numpy as np

from satid_gym.config import real_array

_MOMENT_RANGE = (1e-9, 1e12)  # kg m^2: a chip satellite of 1 g has 1e-7, the International Space Station 2e8
_TRIANGLE = 1e-9  # relative slack of the triangle inequalities: flat plates meet them with equality


def second_moment(inertia: np.ndarray) -> np.ndarray:
    """Second moment of the mass S = sum m r r^T (3, 3), kg m^2, of an inertia tensor J (3, 3): S = tr(J)/2 1 - J.

    J is that of a rigid body if and only if S is positive semidefinite. Each eigenvalue of S is half the sum of two
    principal moments of J minus the third, so it is negative where a triangle inequality is broken; one eigenvalue of
    a flat plate is 0.
    Source: Wensing, Kim, Slotine, IEEE RA-L 3(1), 2018.
    """
    return 0.5 * np.trace(inertia) * np.eye(3) - inertia


def least_second_moment(inertia: np.ndarray) -> float:
    """Smallest eigenvalue of the second moment of an inertia tensor (3, 3), kg m^2; negative if not a rigid body's."""
    return float(np.linalg.eigvalsh(second_moment(inertia))[0])


def inertia_tensor(inertia: object, name: str = "inertia") -> np.ndarray:
    """Inertia tensor of a rigid body, kg m^2, body frame.

    Args:
        inertia: (3,) principal moments along the body axes, or (3, 3) symmetric tensor.
        name: its name in error messages.

    Returns:
        (3, 3) read-only array.

    Raises:
        ValueError: not symmetric, not positive definite, its principal moments are beyond those of any
            spacecraft (1e-9 to 1e12 kg m^2), or they break a triangle inequality, which every rigid body meets.
    """
    array = real_array(name, inertia, (3,), (3, 3))
    tensor = np.diag(array) if array.ndim == 1 else array
    if np.abs(tensor).max() > _MOMENT_RANGE[1]:  # before the others, because products of such moments overflow
        raise _out_of_range(name, np.abs(tensor).max())
    if not np.allclose(tensor, tensor.T, rtol=0.0, atol=1e-9 * np.abs(tensor).max()):
        raise ValueError(f"{name} must be symmetric, got {tensor.tolist()}")
    moments = np.linalg.eigvalsh(tensor)
    if moments[0] <= 0.0:
        raise ValueError(f"{name} must be positive definite; its principal moments are {moments.tolist()}")
    if moments[0] < _MOMENT_RANGE[0]:
        raise _out_of_range(name, moments[0])
    if least_second_moment(tensor) < -0.5 * _TRIANGLE * moments[2]:
        raise ValueError(
            f"{name} breaks the triangle inequality of principal moments: "
            f"{moments[0]:.6g} + {moments[1]:.6g} < {moments[2]:.6g}, so no rigid body can have it"
        )
    tensor = 0.5 * (tensor + tensor.T)
    tensor.flags.writeable = False
    return tensor


def _out_of_range(name: str, moment: float) -> ValueError:
    low, high = _MOMENT_RANGE
    return ValueError(
        f"{name} is beyond any spacecraft's: its moments must be within {low:g} and {high:g} kg m^2, got {moment:g}; "
        "is it in kg m^2?"
    )


def point_inertia(x: np.ndarray) -> np.ndarray:
    """Inertia of a unit mass at x (3,), x^2 1 - x x^T (3, 3)."""
    return x @ x * np.eye(3) - np.outer(x, x)


def turn_slope(axis: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Derivative of an inertia (3, 3) that turns about a unit axis, by the angle: [s x] I - I [s x]."""
    turn = np.cross(axis, inertia, axisb=0, axisc=0)  # s x each column
    return turn + turn.T


def part_inertia(name: str, value: object) -> np.ndarray:
    """Inertia of a part about its own centre of mass (3, 3), kg m^2; 0 is that of a point.

    Args:
        name: its name in error messages.
        value: (3,) principal moments along the body axes, or (3, 3).

    Raises:
        ValueError: it is no rigid body's.
    """
    array = real_array(name, value, (3,), (3, 3))
    tensor = np.diag(array) if array.ndim == 1 else array
    moments = np.linalg.eigvalsh(0.5 * (tensor + tensor.T))
    slack = _TRIANGLE * max(moments[2], 0.0)
    if np.abs(tensor - tensor.T).max() > slack or moments[0] < -slack or moments[0] + moments[1] < moments[2] - slack:
        raise ValueError(
            f"{name} must be a rigid body's: symmetric, no principal moment negative or above the sum of the other "
            f"two; got {tensor.tolist()}"
        )
    tensor = np.array(tensor)
    tensor.flags.writeable = False
    return tensor


def check_left(name: str, left: np.ndarray, rotor_inertia: np.ndarray) -> None:
    """Refuse an inertia that leaves nothing physical without the oscillators.

    Args:
        name: of the satellite.
        left: its inertia less that of the oscillators at rest (3, 3), kg m^2.
        rotor_inertia: A j A^T (3, 3), kg m^2.

    Raises:
        ValueError: what is left is no rigid body's, or no more than its rotors.
    """
    if np.linalg.eigvalsh(left - rotor_inertia)[0] <= 0.0 or least_second_moment(left) < 0.0:
        raise ValueError(
            f"inertia of {name} includes its oscillators at rest, and what is left without them must be that of a "
            f"rigid body with its rotors; left are {left.tolist()}"
        )
