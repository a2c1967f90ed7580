"""Batch estimators of a constant inertia from a whole record of gyro and wheel speeds.

`differentiated` is the paper's: Euler's equation with a numerical derivative of the rates. The others use the
conservation of momentum and differentiate nothing. With C the attitude (body to inertial) that the gyro
gives, a = A j Omega and J omega = L(omega) theta, the momentum in inertial space stays what it was:

    L(omega_k) theta + a_k = C_k^T M_0  [+ C_k^T (integral of C dt) tau]

`momentum_form` solves that as it stands, by linear least squares; gyro noise in L(omega) biases it toward zero
by the noise-to-signal ratio of the rates. `instrumental_variable` removes the bias with rates of the
neighbouring samples, which share the motion but not the noise. `output_error` minimises the distance between
measured and predicted rates, J^-1 (C^T M_0 - a), which is maximum likelihood where the gyro's noise dominates.
All return a physical tensor, or raise where the data do not identify one.
Source: Ljung, System Identification (1999), ch. 7; Soderstrom, Automatica 43(6), 2007 (errors in variables).
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

from satid_gym.config import check_number, real_array, unknown_name
from satid_gym.estimators.batch.fit import InertiaFit, NotIdentifiedError
from satid_gym.estimators.batch.regression import Regression
from satid_gym.estimators.inertia import PARAMETER_COUNT, Parameters, inertia_parameters, inertia_tensors
from satid_gym.estimators.prior import FilterPrior, estimated_parameters

__all__ = [
    "InertiaFit",
    "NotIdentifiedError",
    "differentiated",
    "instrumental_variable",
    "momentum_form",
    "output_error",
]


def differentiated(
    prior: FilterPrior,
    gyro: np.ndarray,
    wheel_speed: np.ndarray,
    dt: float,
    *,
    parameters: Parameters | None = None,
    wheel_acceleration: np.ndarray | None = None,
    huber_scale: float = 1.0,
) -> InertiaFit:
    """The paper's least squares: central differences, bounded trust region, Huber loss.

    Minimises J^-1 (J domega/dt + omega x (J omega + a) + A j alpha). The difference over two sample periods
    costs accuracy wherever the torque changes from one sample to the next.

    Args:
        prior: wheels and data sheets; its inertia is the start of the search.
        gyro: (N, 3) rad/s.
        wheel_speed: (N, n) rad/s.
        dt: s between readings.
        parameters: "principal", "full", or None: what the prior needs.
        wheel_acceleration: (N, n) rad/s^2 at the readings, as the motors' drive reports it; central differences
            of the wheel speeds where None, which cancels most of the error of those of the rates.
        huber_scale: rad/s^2, residual from which on the loss is linear.

    Raises:
        NotIdentifiedError: the data do not identify the inertia about some axis; the message says which.
        ValueError: a shape or a value is wrong.
    """
    parameters = estimated_parameters(parameters, prior)
    gyro, wheel_speed, dt = _readings(prior, gyro, wheel_speed, dt, parameters)
    spin = prior.wheels.axes * prior.wheels.inertia
    if wheel_acceleration is None:
        acceleration = np.gradient(wheel_speed, dt, axis=0)
    else:
        acceleration = real_array("wheel_acceleration", wheel_acceleration, wheel_speed.shape)
    derivative = np.gradient(gyro, dt, axis=0)
    regress = _regressor(gyro, parameters)
    design = _regressor(derivative, parameters) + np.cross(gyro[:, :, None], regress, axis=1)
    target = -np.cross(gyro, wheel_speed @ spin.T) - acceleration @ spin.T
    halved = 0.5 / dt**2  # variance of a central difference over that of a sample
    rows = _regression(prior, design, target, parameters, dt, noise_factor=halved)
    return rows.nonlinear(np.eye(3), "huber", check_number("huber_scale", huber_scale, strict=True))


def momentum_form(
    prior: FilterPrior,
    gyro: np.ndarray,
    wheel_speed: np.ndarray,
    dt: float,
    *,
    parameters: Parameters | None = None,
    constant_torque: bool = False,
) -> InertiaFit:
    """Conservation of momentum, solved by linear least squares.

    Args:
        prior: wheels and data sheets; its inertia weights the axes against each other.
        gyro: (N, 3) rad/s.
        wheel_speed: (N, n) rad/s.
        dt: s between readings; the error of the attitude goes with the square of the angle turned in it.
        parameters: "principal", "full", or None: what the prior needs.
        constant_torque: whether an unknown external torque, constant in the body frame, is estimated as well.

    Raises:
        NotIdentifiedError: the data do not identify the inertia about some axis; the message says which.
        ValueError: a shape or a value is wrong.
    """
    parameters = estimated_parameters(parameters, prior)
    return _momentum_regression(prior, gyro, wheel_speed, dt, parameters, constant_torque).linear()


def instrumental_variable(
    prior: FilterPrior,
    gyro: np.ndarray,
    wheel_speed: np.ndarray,
    dt: float,
    *,
    parameters: Parameters | None = None,
    constant_torque: bool = False,
) -> InertiaFit:
    """`momentum_form` with the mean rate of the two neighbouring samples as the instrument.

    Consistent under white gyro noise, however strong. It needs motion that lasts for several samples.
    Arguments and errors are those of `momentum_form`.
    """
    parameters = estimated_parameters(parameters, prior)
    rows = _momentum_regression(prior, gyro, wheel_speed, dt, parameters, constant_torque)
    gyro, attitude = real_array("gyro", gyro), rows.attitude
    assert attitude is not None
    inner = dataclasses.replace(rows, design=rows.design[1:-1], target=rows.target[1:-1], attitude=attitude[1:-1])
    instruments = inner.design.copy()
    instruments[:, :, : inner.count] = _regressor(0.5 * (gyro[:-2] + gyro[2:]), parameters)
    return inner.instrumental(instruments)


def output_error(
    prior: FilterPrior,
    gyro: np.ndarray,
    wheel_speed: np.ndarray,
    dt: float,
    *,
    parameters: Parameters | None = None,
    constant_torque: bool = False,
) -> InertiaFit:
    """Least distance between measured rates and those that wheel speeds and momentum predict.

    Arguments and errors are those of `momentum_form`.
    """
    parameters = estimated_parameters(parameters, prior)
    rows = _momentum_regression(prior, gyro, wheel_speed, dt, parameters, constant_torque)
    J_inv = np.linalg.inv(inertia_tensors(rows.start))
    weight = np.linalg.inv(np.linalg.cholesky(J_inv @ rows.noise(rows.start) @ J_inv))
    return rows.nonlinear(weight, "linear")


def _readings(
    prior: FilterPrior, gyro: np.ndarray, wheel_speed: np.ndarray, dt: float, parameters: Parameters
) -> tuple[np.ndarray, np.ndarray, float]:
    if parameters not in PARAMETER_COUNT:
        raise unknown_name("inertia parameters", parameters, PARAMETER_COUNT)
    gyro = real_array("gyro", gyro)
    least = PARAMETER_COUNT[parameters] + 3
    if gyro.ndim != 2 or gyro.shape[1] != 3 or len(gyro) < least:
        raise ValueError(f"gyro must have shape (N, 3) with N >= {least}, got {gyro.shape}")
    wheel_speed = real_array("wheel_speed", wheel_speed, (len(gyro), prior.wheels.count))
    return gyro, wheel_speed, check_number("dt", dt, strict=True)


def _regressor(omega: np.ndarray, parameters: Parameters) -> np.ndarray:
    """L (N, 3, p) of rates (N, 3): J omega = L(omega) theta."""
    units = inertia_tensors(np.eye(PARAMETER_COUNT[parameters]))
    return np.einsum("pij,nj->nip", units, omega)


def _regression(
    prior: FilterPrior,
    design: np.ndarray,
    target: np.ndarray,
    parameters: Parameters,
    dt: float,
    *,
    noise_factor: float = 1.0,
    attitude: np.ndarray | None = None,
) -> Regression:
    """Rows with the noise of the prior's sensors."""
    wheels = prior.wheels
    spin = wheels.axes * wheels.inertia
    return Regression(
        design=design,
        target=target,
        start=inertia_parameters(prior.inertia, parameters),
        scale=prior.theta_scale(parameters),
        parameters=parameters,
        gyro_noise_std=prior.gyro_noise_std,
        wheel_noise=spin @ spin.T * prior.tachometer_noise_std**2,
        noise_factor=noise_factor,
        dt=dt,
        attitude=attitude,
    )


def _momentum_regression(
    prior: FilterPrior,
    gyro: np.ndarray,
    wheel_speed: np.ndarray,
    dt: float,
    parameters: Parameters,
    constant_torque: bool,
) -> Regression:
    """Rows of the conservation of momentum; nuisances M_0, and tau where asked for."""
    gyro, wheel_speed, dt = _readings(prior, gyro, wheel_speed, dt, parameters)
    wheels = prior.wheels
    attitude = attitudes_after(0.5 * dt * (gyro[1:] + gyro[:-1]))
    to_body = attitude.transpose(0, 2, 1)
    columns = [_regressor(gyro, parameters), -to_body]
    if constant_torque:
        impulse = np.zeros_like(attitude)
        impulse[1:] = np.cumsum(0.5 * dt * (attitude[1:] + attitude[:-1]), axis=0)
        columns.append(-to_body @ impulse)
    target = -(wheel_speed * wheels.inertia) @ wheels.axes.T
    return _regression(prior, np.concatenate(columns, axis=2), target, parameters, dt, attitude=attitude)


def attitudes_after(turns: np.ndarray) -> np.ndarray:
    """C (N, 3, 3), body to the frame of the first reading, after rotation vectors (N - 1, 3) from one to the next."""
    attitude = np.empty((len(turns) + 1, 3, 3))
    attitude[0] = np.eye(3)
    for k, turn in enumerate(Rotation.from_rotvec(turns).as_matrix()):
        attitude[k + 1] = attitude[k] @ turn
    return attitude
