"""Polynomials with integer coefficients, and a state space as a ratio of two of them, without any rounding.

Every double is an integer times a power of two, so det(sI - A) and C adj(sI - A) B of a given model are known exactly;
signs, common factors, multiplicities and the number of roots in an interval are then facts, however close to each other
the roots lie. Used where double precision cannot tell: docs/theory/margins.md.

A polynomial is a list of int, coefficients of rising powers, without leading zeros; the zero polynomial is [].

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

import numpy as np
import scipy.linalg

from pilotgen.errors import PilotgenError
from pilotgen.linear.statespace import StateSpaceModel

Polynomial = list[int]

_PRIME = (1 << 61) - 1  # common factors are looked for modulo this prime first


@dataclass(frozen=True)
class Rational:
    """num(s / scale) / den(s / scale) with scale = 2^exponent [rad/s]; common factors are kept."""

    num: Polynomial
    den: Polynomial
    exponent: int


@dataclass(frozen=True)
class Dyadic:
    """The number c 2^-k."""

    c: int
    k: int


# ---- a state space as a ratio of polynomials


def rational(model: StateSpaceModel) -> Rational:
    """L(s) = num / den with den = det(sI - A) times a constant, exactly.

    Parameters
    ----------
    model : StateSpaceModel
        Its matrices are taken as exact numbers. Work grows as n^2 times the number of nonzero entries of A.
    """
    A, B, C = _balanced(model)
    rows, a = _integers(A.reshape(-1))
    Bi, b = _integers(B)
    Ci, c = _integers(C)
    (Di,), d = _integers([model.D])
    n = model.n_states
    sparse = [[(j, rows[n * i + j]) for j in range(n) if rows[n * i + j]] for i in range(n)]
    den, strict = _faddeev_leverrier(sparse, Bi, Ci)
    # L = Di 2^-d + 2^(a - b - c) strict / den, in the variable s 2^a
    shift = a - b - c
    low = min(-d, shift)
    num = add([Di * p << (-d - low) for p in den], [p << (shift - low) for p in strict])
    if low < 0:
        den = [p << -low for p in den]
    else:
        num = [p << low for p in num]
    return Rational(*_without_content(num, den), -a)


def rational_from_polynomials(num: Sequence[float], den: Sequence[float]) -> Rational:
    """num / den, exactly.

    Parameters
    ----------
    num, den : sequence of float
        Coefficients of falling powers of s [rad/s].

    Raises
    ------
    PilotgenError
        The denominator is zero, or of lower degree than the numerator.
    """
    values, _ = _integers([*num, *den])
    upper, lower = trim(values[: len(num)][::-1]), trim(values[len(num) :][::-1])
    if not lower:
        raise PilotgenError("the denominator is zero")
    if len(upper) > len(lower):
        raise PilotgenError(
            f"an improper transfer function, degree {len(upper) - 1} over {len(lower) - 1}; its gain grows without "
            "limit, and no margin exists"
        )
    return Rational(*_without_content(upper, lower), 0)


def rational_from_factors(zeros: Sequence[complex], poles: Sequence[complex], gain: float) -> Rational:
    """gain prod(s - zeros) / prod(s - poles), exactly; complex ones [rad/s] come in conjugate pairs.

    Raises
    ------
    PilotgenError
        More zeros than poles, or complex ones without their conjugates.
    """
    if len(zeros) > len(poles) and gain != 0.0:
        raise PilotgenError(f"an improper loop, {len(zeros)} zeros over {len(poles)} poles; no margin exists")
    numerator, denominator = _expanded(zeros, "zeros"), _expanded(poles, "poles")
    (k,), b = _integers([gain])
    upper, lower = [k * c for c in numerator[0]], denominator[0]
    up, down = numerator[1] - denominator[1] - b, 0
    if up < 0:
        up, down = 0, -up
    return Rational(*_without_content(trim([c << up for c in upper]), [c << down for c in lower]), 0)


def _expanded(roots: Sequence[complex], what: str) -> tuple[Polynomial, int]:
    """Integers and e, with prod(s - roots) their polynomial times 2^e."""
    left = [complex(r) for r in roots]
    product: Polynomial = [1]
    exponent = 0
    while left:
        r = left.pop()
        values: list[Fraction] = [-Fraction(r.real), Fraction(1)]
        if r.imag != 0.0:
            if r.conjugate() not in left:
                raise PilotgenError(f"complex {what} come in conjugate pairs; {r.real:g}{r.imag:+g}j stands alone")
            left.remove(r.conjugate())
            values = [Fraction(r.real) ** 2 + Fraction(r.imag) ** 2, -2 * Fraction(r.real), Fraction(1)]
        scale = max(v.denominator for v in values)
        product = multiply(product, [int(v * scale) for v in values])
        exponent -= scale.bit_length() - 1
    return product, exponent


def _balanced(model: StateSpaceModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The model in states scaled by powers of two, which changes no digit: smaller integers."""
    if model.n_states == 0:
        return model.A, model.B, model.C
    A, (scale, _) = scipy.linalg.matrix_balance(model.A, permute=False, separate=True)
    B, C = model.B / scale, model.C * scale
    back = (A / scale) * scale[:, None]
    if np.array_equal(back, model.A) and np.array_equal(B * scale, model.B) and np.array_equal(C / scale, model.C):
        return A, B, C
    return model.A, model.B, model.C


def _integers(values: Iterable[float]) -> tuple[list[int], int]:
    """Integers m and e with values = m 2^-e."""
    pairs = [float(value).as_integer_ratio() for value in values]
    e = max((q.bit_length() - 1 for p, q in pairs if p), default=0)
    m = [p << (e - q.bit_length() + 1) if p else 0 for p, q in pairs]
    if e == 0 and any(m):  # integers: take out what twos they share
        e = -min((x & -x).bit_length() - 1 for x in m if x)
        m = [x >> -e for x in m]
    return m, e


def _faddeev_leverrier(rows: list[list[tuple[int, int]]], B: list[int], C: list[int]) -> tuple[Polynomial, Polynomial]:
    """det(sI - A) and C adj(sI - A) B for an integer matrix given by its rows of (column, entry)."""
    n = len(rows)
    den, num = [0] * n + [1], [0] * n
    M = [[int(i == j) for j in range(n)] for i in range(n)]
    for k in range(1, n + 1):
        MB = [sum(m * b for m, b in zip(row, B, strict=True) if m and b) for row in M]
        num[n - k] = sum(c * v for c, v in zip(C, MB, strict=True) if c)
        new = []
        for row in rows:
            total = [0] * n
            for j, a in row:
                total = [t + a * m for t, m in zip(total, M[j], strict=True)]
            new.append(total)
        den[n - k] = -sum(new[i][i] for i in range(n)) // k
        for i in range(n):
            new[i][i] += den[n - k]
        M = new
    return den, trim(num)


def _without_content(num: Polynomial, den: Polynomial) -> tuple[Polynomial, Polynomial]:
    g = math.gcd(*num, *den)
    return ([p // g for p in num], [p // g for p in den]) if g > 1 else (num, den)


# ---- arithmetic


def trim(p: Polynomial) -> Polynomial:
    """Without leading zeros."""
    n = len(p)
    while n and not p[n - 1]:
        n -= 1
    return p[:n]


def add(p: Sequence[int], q: Sequence[int], sign: int = 1) -> Polynomial:
    """p + sign q."""
    n = max(len(p), len(q))
    return trim([(p[i] if i < len(p) else 0) + sign * (q[i] if i < len(q) else 0) for i in range(n)])


def multiply(p: Sequence[int], q: Sequence[int]) -> Polynomial:
    """The product p q."""
    if not p or not q:
        return []
    out = [0] * (len(p) + len(q) - 1)
    for i, a in enumerate(p):
        if a:
            for j, b in enumerate(q):
                out[i + j] += a * b
    return out


def derivative(p: Polynomial) -> Polynomial:
    """dp/dx."""
    return [k * p[k] for k in range(1, len(p))]


def primitive(p: Polynomial) -> Polynomial:
    """p over the greatest common divisor of its coefficients, signs kept."""
    g = math.gcd(*p) if p else 1
    return [c // g for c in p] if g > 1 else p


def gcd(p: Polynomial, q: Polynomial) -> Polynomial:
    """Greatest common divisor, primitive; [1] if there is none."""
    p, q = primitive(p), primitive(q)
    if not p or not q:
        return p or q
    if len(p) == 1 or len(q) == 1 or _coprime_modulo(p, q):
        return [1]
    if len(p) < len(q):
        p, q = q, p
    while q:
        p, q = q, primitive(_pseudo_remainder(p, q))
    return p if p[-1] > 0 else [-c for c in p]


def _pseudo_remainder(p: Polynomial, q: Polynomial) -> Polynomial:
    r, lead = list(p), q[-1]
    while len(r) >= len(q):
        g = math.gcd(r[-1], lead)
        up, down = lead // g, r[-1] // g
        shift = len(r) - len(q)
        r = [up * c for c in r]
        for i, c in enumerate(q):
            r[shift + i] -= down * c
        r = trim(r)
    return r


def _coprime_modulo(p: Polynomial, q: Polynomial) -> bool:
    """Whether p and q have no common factor modulo a prime that keeps a degree: then they have none at all."""
    a, b = [c % _PRIME for c in p], [c % _PRIME for c in q]
    if not a[-1] or not b[-1]:
        return False
    while b:
        if len(b) == 1:
            return True
        inverse = pow(b[-1], -1, _PRIME)
        while len(a) >= len(b):
            factor = a[-1] * inverse % _PRIME
            shift = len(a) - len(b)
            for i, c in enumerate(b):
                a[shift + i] = (a[shift + i] - factor * c) % _PRIME
            a = trim(a)
        a, b = b, a
    return False


def divide(p: Polynomial, q: Polynomial) -> Polynomial:
    """p / q up to a positive constant, where q (primitive, positive leading coefficient) divides p.

    ArithmeticError if q does not divide p.
    """
    if q == [1] or not p:
        return p
    r, out = list(primitive(p)), [0] * (len(p) - len(q) + 1)
    for k in range(len(out) - 1, -1, -1):
        out[k], left = divmod(r[k + len(q) - 1], q[-1])
        if left:
            raise ArithmeticError("a polynomial division that should be exact left a remainder")
        for i, c in enumerate(q):
            r[k + i] -= out[k] * c
    return out


def even_odd(p: Polynomial) -> tuple[Polynomial, Polynomial]:
    """p(j w) = even(x) + j w odd(x), with x = w^2."""
    sign = (1, -1)
    return (
        trim([c * sign[i % 2] for i, c in enumerate(p[0::2])]),
        trim([c * sign[i % 2] for i, c in enumerate(p[1::2])]),
    )


def quotient(a: int, b: int) -> float:
    """a / b, rounded once; infinite beyond the range of doubles."""
    try:
        return a / b
    except OverflowError:
        return math.copysign(math.inf, 1.0 if (a > 0) == (b > 0) else -1.0)


# ---- roots


def is_hurwitz(p: Polynomial) -> bool:
    """Whether every root of p (degree 1 or more) has a negative real part, by Routh's scheme."""
    if p[-1] < 0:
        p = [-c for c in p]
    if min(p) <= 0:
        return False
    upper, lower = p[-1::-2], p[-2::-2]
    while lower:
        if lower[0] <= 0:
            return False
        shorter = [*lower[1:], *([0] * (len(upper) - len(lower)))]
        new = [lower[0] * u - upper[0] * v for u, v in zip(upper[1:], shorter, strict=True)]
        upper, lower = lower, primitive(trim(new))
    return True


def positive_roots(p: Polynomial, bits: int = 80) -> list[Dyadic]:
    """The positive roots of p, each once, rising, to `bits` significant bits.

    Descartes' rule of signs with bisection (Vincent, Collins and Akritas) on the squarefree part of p tells them apart;
    quadratic interval refinement (Abbott) finds their digits.
    """
    zero_roots = next((i for i, c in enumerate(p) if c), len(p))
    p = primitive(p[zero_roots:])
    if len(p) < 2 or _variations(p) == 0:
        return []
    p = divide(p, gcd(p, derivative(p)))
    # All roots are below 2^bound (Cauchy): x = 2^bound y with y in (0, 1).
    n, lead = len(p) - 1, abs(p[-1]).bit_length()
    bound = 1 + max(-(-(abs(c).bit_length() - lead + 1) // (n - i)) for i, c in enumerate(p[:-1]) if c)
    scaled = [c << bound * i if bound >= 0 else c << -bound * (n - i) for i, c in enumerate(p)]
    scaled = primitive(scaled)
    found: list[Dyadic] = []
    stack = [(scaled, 0, 0)]
    while stack:
        q, c, k = stack.pop()
        if q[0] == 0:
            found.append(_digits(c, k, bits))
            q = q[1:]
        changes = _variations(_shift(q[::-1]))
        if changes == 1:
            found.append(_refine(scaled, c, k, bits))
        elif changes > 1:
            m = len(q) - 1
            left = [a << (m - i) for i, a in enumerate(q)]
            stack.append((_shift(left), 2 * c + 1, k + 1))
            stack.append((left, 2 * c, k + 1))
    return [Dyadic(x.c << max(bound - x.k, 0), max(x.k - bound, 0)) for x in found]


def _shift(p: Polynomial) -> Polynomial:
    """p(x + 1)."""
    out = list(p)
    for i in range(len(out) - 1):
        for j in range(len(out) - 2, i - 1, -1):
            out[j] += out[j + 1]
    return out


def _variations(p: Polynomial) -> int:
    """Changes of sign in the coefficients."""
    signs = [c > 0 for c in p if c]
    return sum(a != b for a, b in pairwise(signs))


def value(p: Polynomial, x: Dyadic) -> int:
    """p(x) times 2^(x.k degree), x.k not negative: an integer."""
    total, shift = 0, 0
    for a in reversed(p):
        total = total * x.c + (a << shift)
        shift += x.k
    return total


def _digits(c: int, k: int, bits: int) -> Dyadic:
    more = max(bits - c.bit_length(), 0)
    return Dyadic(c << more, k + more)


def _refine(p: Polynomial, c: int, k: int, bits: int) -> Dyadic:
    """The only root of p in the open interval from c 2^-k to (c + 1) 2^-k."""
    n = len(p) - 1
    low, high = value(p, Dyadic(c, k)), value(p, Dyadic(c + 1, k))
    if low == 0 or high == 0:  # an end is a root of its own: the sign beside it is that of the slope, or its opposite
        d = derivative(p)
        if low == 0:
            low = 1 if value(d, Dyadic(c, k)) > 0 else -1
        if high == 0:
            high = -1 if value(d, Dyadic(c + 1, k)) > 0 else 1
    step = 1
    while c.bit_length() < bits:
        parts = 1 << step
        at = min(max((low << step) // (low - high), 0), parts - 1)
        fine, level = (c << step) + at, k + step
        at_fine = value(p, Dyadic(fine, level)) if at else low << step * n
        at_next = value(p, Dyadic(fine + 1, level)) if at + 1 < parts else high << step * n
        if at and at_fine == 0:
            return _digits(fine, level, bits)
        if at + 1 < parts and at_next == 0:
            return _digits(fine + 1, level, bits)
        if (at_fine > 0) != (at_next > 0):
            c, k, low, high = fine, level, at_fine, at_next
            step *= 2
        elif step > 1:
            step //= 2
        else:  # the other half
            c, k = (fine + 1, level) if at == 0 else (fine - 1, level)
            low, high = (at_next, high << n) if at == 0 else (low << n, at_fine)
    return Dyadic(2 * c + 1, k + 1)
