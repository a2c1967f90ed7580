"""Random numbers of one environment: a stream that no other environment, thread or action can disturb.

xoshiro256++ (Blackman and Vigna, 2021) gives the bits; its state is four words in the episode's record, so
an environment draws the same numbers alone or among a thousand. Normal deviates come from the ziggurat of
Marsaglia and Tsang in Doornik's form (2005) with 128 layers.
"""

from __future__ import annotations

import numpy as np

from satid_gym.core.jit import inline, outline

_LAYERS = 128
_TAIL = 3.442619855899  # where the base layer's tail begins
_AREA = 9.91256303526217e-3  # area of every layer


def _ziggurat() -> tuple[np.ndarray, np.ndarray]:
    """Layer edges x (129,) and the ratios x[i + 1] / x[i] (128,)."""
    x = np.zeros(_LAYERS + 1)
    density = np.exp(-0.5 * _TAIL**2)
    x[0], x[1] = _AREA / density, _TAIL
    for i in range(2, _LAYERS):
        x[i] = np.sqrt(-2.0 * np.log(_AREA / x[i - 1] + density))
        density = np.exp(-0.5 * x[i] ** 2)
    return x, x[1:] / x[:-1]


_EDGE, _RATIO = _ziggurat()


@inline
def _rotl(x, k):
    return (x << np.uint64(k)) | (x >> np.uint64(64 - k))


@inline
def next_word(stream):
    """Next 64 random bits of the stream (4,), which moves on."""
    s0, s1, s2, s3 = stream[0], stream[1], stream[2], stream[3]
    result = _rotl(s0 + s3, 23) + s0
    t = s1 << np.uint64(17)
    s2 ^= s0
    s3 ^= s1
    s1 ^= s2
    s0 ^= s3
    s2 ^= t
    s3 = _rotl(s3, 45)
    stream[0], stream[1], stream[2], stream[3] = s0, s1, s2, s3
    return result


@inline
def _fraction(word):
    """An odd multiple of 2^-53: exact, and symmetric within (0, 1), of which it never meets an end."""
    return np.float64((word >> np.uint64(11)) | np.uint64(1)) * 2.0**-53


@outline
def uniform(stream):
    """Uniform on (0, 1), 52 bits, never 0 or 1."""
    return _fraction(next_word(stream))


@outline
def normal(stream):
    """Standard normal deviate."""
    while True:
        word = next_word(stream)
        layer = np.int64(word & np.uint64(_LAYERS - 1))
        u = 2.0 * _fraction(word) - 1.0
        if abs(u) < _RATIO[layer]:
            return u * _EDGE[layer]
        if layer == 0:
            while True:
                x = np.log(uniform(stream)) / _TAIL
                y = np.log(uniform(stream))
                if -2.0 * y >= x * x:
                    return x - _TAIL if u < 0.0 else _TAIL - x
        x = u * _EDGE[layer]
        outer = np.exp(-0.5 * (_EDGE[layer] ** 2 - x * x))
        inner = np.exp(-0.5 * (_EDGE[layer + 1] ** 2 - x * x))
        if inner + uniform(stream) * (outer - inner) < 1.0:
            return x


@inline
def between(stream, low, high):
    """Uniform on [low, high]."""
    return low + (high - low) * uniform(stream)
