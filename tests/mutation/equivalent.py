"""Survivors that no test can kill: the mutant does what the original does, to within rounding.

By module and by what `python -m tests.mutation` prints, each with its reason.
"""

from __future__ import annotations

EQUIVALENT: dict[str, dict[str, str]] = {
    "core/reward": {
        "spread: if not product > 0.0: -> if not product >= 0.0:": "factor gives a positive product or -1, never 0",
    },
    "core/generator": {
        "_draw_body: low = -1.0 if plant.law == PERIODIC else 0.0 -> low = -1.0 if plant.law == PERIODIC else 1.0": (
            "the end without change is the inertia itself, which is checked once more before it is taken"
        ),
    },
    "core/rate_filter": {
        "condition: for r in range(3 + n): -> for r in range(3 - n):": (
            "the rows start as zeros, and the same places are written every time"
        ),
        "condition: for r in range(3 + n): -> for r in range(2 + n):": "as above",
        "predict: identity = work.jacobian[3] -> identity = work.jacobian[2]": "what was there is not needed any more",
    },
    "core/kalman": {
        ": _MOST_HALVINGS = 40 -> _MOST_HALVINGS = 39": "an update of 10^12 times the inertia is beyond any sensor",
        ": _CANCELLATION = 10.0 -> _CANCELLATION = 20.0": "Joseph's second half mends rounding, and no more",
        "update: continue -> pass": "likewise, where there is next to nothing to mend",
    },
    "core/momentum_filter": {
        "start: moment = work.jacobian[1] -> moment = work.jacobian[0]": "what was there is not needed any more",
        (
            "_beyond: return rate if rate * rate > _NOTHING ** 2 * spin * (1.0 - spin / noise) else 0.0 -> "
            "return rate if rate * rate >= _NOTHING ** 2 * spin * (1.0 - spin / noise) else 0.0"
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
}
