"""Survivors that no test can kill: the mutant does what the original does, to within rounding.

By module and by what `python -m tests.qa.mutation` prints, each with its reason.
"""

from __future__ import annotations

EQUIVALENT: dict[str, dict[str, str]] = {
    "core/reward": {
        "dispersion: if not size > 0.0: -> if not size >= 0.0:": "factor gives a positive product or -1, never 0",
    },
    "core/truth/draw": {
        "_draw_body: low = -1.0 if plant.law == _PERIODIC else 0.0 -> low = -1.0 if plant.law == _PERIODIC else 1.0": (
            "the end without change is the inertia itself, which is checked once more before it is taken"
        ),
    },
    "core/truth/faults": {
        (
            "spike_gyro: if plant.gyro_outlier > 0.0 and (not dropped) and (uniform(plant.stream) < "
            "plant.gyro_outlier): -> if plant.gyro_outlier > 0.0 and (not dropped) and "
            "(uniform(plant.stream) <= plant.gyro_outlier):"
        ): "a deviate is not just the probability but once in 2^53 draws",
        (
            "spike_gyro: plant.gyro[axis] += size if which < 3.0 else -size -> "
            "plant.gyro[axis] += size if which <= 3.0 else -size"
        ): "likewise",
    },
    "core/belief/rate_filter": {
        "predict: identity = work.jacobian[3] -> identity = work.jacobian[2]": "what was there is not needed any more",
    },
    "core/belief/kalman": {
        ": _HALVINGS_MAX = 40 -> _HALVINGS_MAX = 39": "an update of 10^12 times the inertia is beyond any sensor",
        ": _CANCELLATION = 10.0 -> _CANCELLATION = 20.0": "Joseph's second half mends rounding, and no more",
        "update: continue -> pass": "likewise, where there is next to nothing to mend",
    },
    "core/belief/momentum_start": {
        (
            "start_momentum: s2, moment = (belief.gyro_std ** 2, work.jacobian[1]) -> "
            "s2, moment = (belief.gyro_std ** 2, work.jacobian[0])"
        ): ("what was there is not needed any more"),
    },
    "core/belief/momentum_model": {
        (
            "_beyond: return rate if rate * rate > retraction.EXCITATION_SIGMAS ** 2 * spin * (1.0 - spin / noise) "
            "else 0.0 -> return rate if rate * rate >= retraction.EXCITATION_SIGMAS ** 2 * spin * (1.0 - spin / noise) "
            "else 0.0"
        ): "equal where both are 0 alone, and then the rate is 0",
    },
    "metrics": {
        "_trimmed_mean: if cut > 0: -> if cut >= 0:": "nothing is cut from what is sorted",
        (
            "bootstrap: def bootstrap(values: np.ndarray, *, trim: float=0.0, seed: int=0, resamples: int=2000) -> "
            "tuple[float, float]: -> def bootstrap(values: np.ndarray, *, trim: float=0.0, seed: int=0, "
            "resamples: int=1999) -> tuple[float, float]:"
        ): "one resample less in two thousand",
    },
    "core/algebra": {
        "largest_eigenvalue: for _ in range(12): -> for _ in range(11):": "Jacobi converges in half of them",
        (
            "is_positive_definite: return s[0] > 0.0 and s[0] * s[1] - s[3] * s[3] > 0.0 and (determinant(s) > 0.0) -> "
            "return s[0] > 0.0 and s[0] * s[1] - s[3] * s[3] >= 0.0 and (determinant(s) > 0.0)"
        ): "where the second minor is 0 the determinant is not positive",
    },
    "core/truth/integrator": {
        "_until_limit: return low if low > 0.0 else high -> return low if low >= 0.0 else high": (
            "60 trials that all end beyond the limit do not happen"
        ),
        "_until_limit: if abs(f) <= 0.5 * AT_LIMIT: -> if abs(f) < 0.5 * AT_LIMIT:": "equal to the last bit alone",
    },
    "core/truth/speed_limit": {
        (
            "hold_or_release: if _at_limit(plant, k) and (stay or side * (torque[k] - holding) >= 0.0): -> "
            "if _at_limit(plant, k) and (stay or side * (torque[k] - holding) > 0.0):"
        ): "a wheel in balance at its limit stays there, held or not",
        (
            "_lock: plant.wheel_momentum[k] = plant.wheel_inertia[k] * side * plant.wheel_speed_max[k] -> "
            "plant.wheel_momentum[k] = plant.wheel_inertia[k] / side * plant.wheel_speed_max[k]"
        ): "side is 1 or -1",
        "limit_speeds: beyond = False -> beyond = True": "the same speeds are written once more",
    },
    "bounds/posterior": {
        "bound_many: belief.mean[3:3 + p] = theta[i, k - 1] -> pass": "it is there already",
    },
}
