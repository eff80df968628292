"""Exact polynomials, and their signs over the unit box by Bernstein coefficients."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction

Polynomial = dict[tuple[int, ...], Fraction | int]
"""Coefficients by the exponents of the parameters; coefficients that are left out are zero."""


def product(one: Polynomial, other: Polynomial) -> Polynomial:
    """Multiply two polynomials of the same parameters."""
    found: Polynomial = {}
    for left, factor in one.items():
        for right, value in other.items():
            power = tuple(a + b for a, b in zip(left, right, strict=True))
            found[power] = found.get(power, 0) + factor * value
    return found


def add(total: Polynomial, term: Mapping[tuple[int, ...], Fraction | int], factor: Fraction | int = 1) -> None:
    """Add a multiple of a polynomial to another one, which is changed."""
    for power, value in term.items():
        total[power] = total.get(power, 0) + factor * value


def is_at_least_zero(polynomial: Polynomial, parameters: int, degree: int, *, strictly: bool = False) -> bool:
    """Return True if Bernstein coefficients prove a polynomial non-negative on the unit box."""
    terms = [(power, value) for power, value in polynomial.items() if value]
    if not terms:
        return not strictly
    if all(not any(power) for power, _ in terms):
        return terms[0][1] > 0
    weights = _weights(degree)
    places: list[tuple[int, ...]] = [()]
    for _ in range(parameters):
        places = [(*place, k) for place in places for k in range(degree + 1)]
    for place in places:
        total: Fraction | int = 0
        for power, value in terms:
            weight = 1
            for k, exponent in zip(place, power, strict=True):
                weight *= weights[k][exponent]
            total += weight * value
        if total < 0 or (strictly and total == 0):
            return False
    return True


def _weights(degree: int) -> list[list[int]]:
    """Return the weights of powers of one parameter in Bernstein coefficients.

    Entry [k][j] is binom(k, j) / binom(degree, j) for the power j in the coefficient k, times a common denominator.
    """
    shared = math.lcm(*(math.comb(degree, j) for j in range(degree + 1)))
    return [[math.comb(k, j) * shared // math.comb(degree, j) for j in range(degree + 1)] for k in range(degree + 1)]
