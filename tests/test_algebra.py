"""The core's small matrices against numpy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit
from scipy.spatial.transform import Rotation

from satid_gym.core import algebra, factors
from satid_gym.rigid_body import inertia_tensor
from tests.cases import cases

SIZES = (3, 6)


@njit
def run_unary(s):
    out = np.empty((3, 3))
    algebra.store_symmetric(out, algebra.inverse(algebra.load_symmetric(s)))
    return out, algebra.determinant(algebra.load_symmetric(s))


@njit
def run_congruence(b, a):
    out = np.empty((3, 3))
    algebra.store_symmetric(out, algebra.congruence(algebra.load_symmetric(b), algebra.load_symmetric(a)))
    return out


@njit
def run_sums(k, a, b):
    out, shifted = np.empty((3, 3)), np.empty((3, 3))
    s = algebra.load_symmetric(a)
    algebra.store_symmetric(out, algebra.axpy_symmetric(k, s, algebra.load_symmetric(b)))
    algebra.store_symmetric(shifted, algebra.add_diagonal(k, s))
    return out, shifted


@njit
def run_vectors(k, s, a, b):
    out = np.empty((5, 3))
    u, v = algebra.load(a), algebra.load(b)
    algebra.store(out[0], algebra.multiply(algebra.load_symmetric(s), u))
    algebra.store(out[1], algebra.cross(u, v))
    algebra.store(out[2], algebra.axpy(k, u, v))
    algebra.store(out[3], algebra.add(u, v))
    algebra.store(out[4], algebra.subtract(u, v))
    return out


@njit
def run_tests(s):
    return algebra.is_positive_definite(algebra.load_symmetric(s)), algebra.is_physical(algebra.load_symmetric(s))


@njit
def run_factor(a, first, size, error):
    work = np.zeros((size, size))
    product = factors.factor(a, first, size, work)
    return product, factors.mahalanobis(work, error, size) if product > 0.0 else np.nan


@njit
def run_largest_eigenvalue(a, size):
    return algebra.largest_eigenvalue(a, size)


def symmetric(rng: np.random.Generator, size: int = 3) -> np.ndarray:
    a = rng.normal(size=(size, size))
    return a + a.T


def positive(rng: np.random.Generator, size: int = 3) -> np.ndarray:
    a = rng.normal(size=(size, size))
    return a @ a.T + 0.1 * np.eye(size)


@cases("seed", range(5))
def test_matrices_of_three(seed):
    rng = np.random.default_rng(seed)
    s, b, k = symmetric(rng), symmetric(rng), rng.normal()
    inverse, determinant = run_unary(s)
    np.testing.assert_allclose(inverse, np.linalg.inv(s), rtol=1e-10, atol=1e-12)
    assert determinant == pytest.approx(np.linalg.det(s), rel=1e-12)
    np.testing.assert_allclose(run_congruence(b, s), b @ s @ b, rtol=1e-12, atol=1e-13)
    total, shifted = run_sums(k, s, b)
    np.testing.assert_allclose(total, k * s + b, rtol=0, atol=1e-14)
    np.testing.assert_allclose(shifted, k * np.eye(3) + s, rtol=0, atol=1e-14)


@cases("seed", range(5))
def test_vectors_of_three(seed):
    rng = np.random.default_rng(seed)
    s, a, b, k = symmetric(rng), rng.normal(size=3), rng.normal(size=3), rng.normal()
    expected = [s @ a, np.cross(a, b), k * a + b, a + b, a - b]
    np.testing.assert_allclose(run_vectors(k, s, a, b), expected, rtol=0, atol=1e-14)


@cases("size", SIZES)
@cases("seed", range(5))
def test_factor_gives_determinant_and_mahalanobis_distance(size, seed):
    rng = np.random.default_rng(seed)
    a, error = positive(rng, size + 4), rng.normal(size=size)
    block = a[2 : 2 + size, 2 : 2 + size]
    product, distance = run_factor(a, 2, size, error.copy())
    assert product == pytest.approx(np.linalg.det(block), rel=1e-11)
    assert distance == pytest.approx(error @ np.linalg.solve(block, error), rel=1e-10)


@cases("size", SIZES)
@cases("seed", range(5))
def test_factor_refuses_what_is_not_positive_definite(size, seed):
    rng = np.random.default_rng(seed)
    values = np.linspace(-1e-6, 1.0, size)
    q = np.linalg.qr(rng.normal(size=(size, size)))[0]
    product, _ = run_factor((q * values) @ q.T, 0, size, np.zeros(size))
    assert not product > 0.0


def test_factor_refuses_nan():
    a = np.eye(3)
    a[1, 1] = np.nan
    assert not run_factor(a, 0, 3, np.zeros(3))[0] > 0.0


@njit
def run_factored_inverse(s):
    out = np.empty((3, 3))
    inverted, least = factors.factored_inverse(algebra.load_symmetric(s))
    algebra.store_symmetric(out, inverted)
    return out, least


@cases("spread", [0.0, 3.0, 6.0, 10.0])
@cases("seed", range(5))
def test_factored_inverse_holds_where_the_adjugate_cancels(spread, seed):
    """Up to ten decades between the eigenvalues, where the adjugate is off by 4e-5 and more."""
    rng = np.random.default_rng(seed)
    q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    a = (q * 10.0 ** -np.linspace(0.0, spread, 3)) @ q.T
    a = 0.5 * (a + a.T)
    inverted, least = run_factored_inverse(a)
    assert least > 0.0
    np.testing.assert_allclose(inverted @ a, np.eye(3), rtol=0, atol=1e-14 + 1e-15 * 10.0**spread)


def test_factored_inverse_says_what_is_not_positive_definite():
    for values in ([1.0, 2.0, -1e-6], [-1.0, 2.0, 3.0], [1.0, np.nan, 1.0]):
        q = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
        assert not run_factored_inverse((q * values) @ q.T)[1] > 0.0


@cases("size", SIZES)
@cases("spread", [0.0, 3.0, 8.0])
@cases("seed", range(5))
def test_largest_eigenvalue(size, spread, seed):
    """Up to eight decades between the eigenvalues, as in a covariance that has converged on some axes."""
    rng = np.random.default_rng(seed)
    values = 10.0 ** -np.linspace(0.0, spread, size)
    q = np.linalg.qr(rng.normal(size=(size, size)))[0]
    a = (q * values) @ q.T
    assert run_largest_eigenvalue(a.copy(), size) == pytest.approx(np.linalg.eigvalsh(a)[-1], rel=1e-12)


def test_largest_eigenvalue_of_a_diagonal():
    assert run_largest_eigenvalue(np.diag([2.0, 7.0, 3.0]), 3) == 7.0


@given(
    moments=st.tuples(*[st.floats(0.01, 10.0)] * 3),
    turn=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
)
def test_physical_means_what_the_constructor_says(moments, turn):
    """The core's rule, on second moments, and the constructor's, on principal moments, part the same tensors."""
    small, middle, large = sorted(moments)
    margin = (small + middle - large) / large
    if abs(margin) < 1e-7:
        return  # on the edge rounding decides
    r = Rotation.from_rotvec(turn).as_matrix()
    tensor = r @ np.diag(moments) @ r.T
    tensor = 0.5 * (tensor + tensor.T)
    positive_definite, physical = run_tests(tensor)
    assert positive_definite
    assert physical == (margin > 0.0)
    try:
        inertia_tensor(tensor)
        accepted = True
    except ValueError:
        accepted = False
    assert physical == accepted


def test_a_negative_moment_is_neither_positive_nor_physical():
    assert run_tests(np.diag([1.0, 1.0, -0.5])) == (False, False)
    assert run_tests(np.diag([1.0, 1.0, 2.5])) == (True, False)
    assert run_tests(np.diag([1.0, 1.0, 1.5])) == (True, True)


def test_a_flat_plate_is_physical():
    """The limit of the triangle inequality, which rounding must not decide."""
    assert run_tests(np.diag([1.0, 1.0, 2.0])) == (True, True)
    assert run_tests(np.diag([0.3, 0.1, 0.4])) == (True, True)
    assert run_tests(np.diag([0.3, 0.1, 0.4 * (1.0 + 1e-7)])) == (True, False)
