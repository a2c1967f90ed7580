"""A satellite with tilted wheels, your own estimator, your own reward.

python examples/03_bring_your_own_satellite_and_estimator.py
"""

import numpy as np
import scipy.linalg

from satid_gym import InertiaLaw, ReactionWheels, RewardSettings, Satellite, SatInertiaIDEnv
from satid_gym.estimators import FilterPrior

# Spin axes are the columns. Any three or more that span space will do; the action has one entry a wheel.
axes = np.array([[1.0, 0.2, 0.0], [0.0, 1.0, 0.2], [0.2, 0.0, 1.0]])
axes /= np.linalg.norm(axes, axis=0)
satellite = Satellite(
    "surveyor",
    inertia=[2.0, 2.4, 1.8],  # kg m^2, or a (3, 3) tensor; what no rigid body can have is refused
    wheels=ReactionWheels(axes=axes, inertia=5e-4, max_torque=0.03, max_speed=600.0),
    rate_limit=0.04,
    gyro_noise_std=6e-5,
    disturbance_std=3e-5,
)


class MomentumLeastSquares:
    """Recursive least squares on the conservation of momentum, for a constant inertia.

    State [M, theta, tau] as the environment's own filter has it. Each reading says J(theta) omega + a = M, which is
    linear in the state; between readings M turns with the body. The gyro's noise in L(omega) is not accounted for, so
    it is somewhat too sure of itself (NEES above 1).
    """

    coordinates = "momentum"
    parameters = "principal"

    def reset(self, prior: FilterPrior, gyro: np.ndarray, wheel_speed: np.ndarray) -> None:
        """Start from the prior and the first reading."""
        self.spin = prior.wheels.axes * prior.wheels.inertia
        self.noise = prior.gyro_noise_std * np.diag(prior.inertia)  # of J omega
        theta, std = np.diag(prior.inertia), prior.prior_theta_std(self.parameters)
        self.mean = np.concatenate([theta * gyro + self.spin @ wheel_speed, theta, np.zeros(3)])
        start = np.concatenate([np.abs(std * gyro) + self.noise, std, np.full(3, prior.disturbance_std)])
        self.covariance = np.diag(start**2)
        self.rate = gyro

    def predict(self, wheel_speed: np.ndarray, dt: float) -> None:
        """M' = M x omega + tau, with the last measured rate."""
        x, y, z = dt * self.rate
        turn = scipy.linalg.expm(np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]))
        step = np.eye(9)
        step[:3, :3], step[:3, 6:] = turn, dt * np.eye(3)
        self.mean = step @ self.mean
        self.covariance = step @ self.covariance @ step.T
        self.covariance[:3, :3] += np.eye(3) * (dt * self.noise.max()) ** 2

    def update(self, gyro: np.ndarray, wheel_speed: np.ndarray) -> float:
        """0 = M - L(omega) theta - a + noise."""
        self.rate = gyro
        design = np.hstack([np.eye(3), -np.diag(gyro), np.zeros((3, 3))])
        innovation = self.spin @ wheel_speed - design @ self.mean
        spread = design @ self.covariance @ design.T + np.diag(self.noise**2)
        gain = np.linalg.solve(spread, design @ self.covariance).T
        self.mean = self.mean + gain @ innovation
        keep = np.eye(9) - gain @ design
        self.covariance = keep @ self.covariance @ keep.T + gain @ np.diag(self.noise**2) @ gain.T
        return float(innovation @ np.linalg.solve(spread, innovation)) / 3.0


worlds = {
    "its own filter": SatInertiaIDEnv(satellite, InertiaLaw("static")),
    "least squares": SatInertiaIDEnv(
        satellite,
        InertiaLaw("static"),
        estimator=MomentumLeastSquares(),
        reward=RewardSettings(criterion="trace", effort_weight=0.1),  # A-optimality, and torque costs
    ),
}
errors = {}
for name, env in worlds.items():
    observation, info = env.reset(seed=1)
    total = 0.0
    for second in range(120):
        phase = second / 12.0 + np.arange(3) / 3.0
        action = 0.3 * np.where(phase % 1.0 < 0.5, 1.0, -1.0)
        observation, reward, terminated, truncated, info = env.step(action)
        total += reward
    errors[name] = info["relative_error"]
    print(f"{name:15s} error {errors[name]:.2%}, NEES {info['nees']:.2f}, reward {total:.1f}")
