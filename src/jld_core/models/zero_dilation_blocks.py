"""The program over products solved by blocks of the graph of velocities, with the fewest rows that close walls.

Hinges are multiplied with given slacks, slides with those of their own face alone: then t has four products a face
instead of a column of X. What comes out are multipliers like those of `relax`; a certificate decides about them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jld_core.arrays import Bools, Floats, Ints
from jld_core.models.binary_fractions import BITS, BinaryFractions, cut
from jld_core.models.zero_dilation_certificate import Certifier, clean
from jld_core.models.zero_dilation_interior import ProductProgram, minimise
from jld_core.models.zero_dilation_modes import Modes
from jld_core.models.zero_dilation_normal import NormalEquations, Point, ProductSpace
from jld_core.models.zero_dilation_products import (
    Multipliers,
    Region,
    cost_of,
    equal_pairs,
    extended,
    units_of,
    without,
)

_NOTHING: Final = 1e-11  # coefficients below this are rounding of an elimination
_FREE: Final = (1e-6, 1e-4)  # sizes, one after the other, from which a multiplier may change as it must
_GONE: Final = 1e-14  # multipliers below this are none
_SHIFT: Final = 1e-14  # regularisation of the normal equations, refined away
_REFINED: Final = 40  # steps of conjugate gradients for one change
_EXACT: Final = 1e-9  # of what is left, at which they end


def multipliers_in_blocks(
    modes: Modes, region: Region, size: Floats, pairs: Bools, slack: float, seconds: float
) -> Multipliers | None:
    """Multipliers of the program that `relax` states; None where the method does not end well. As for `relax`."""
    count = len(modes.rows)
    unit, wide = units_of(region, size), region.high - region.low
    facts = extended(modes, region) @ unit
    largest = abs(facts).max(axis=1)
    statics = modes.statics @ unit
    held, moving = np.flatnonzero(region.held), np.flatnonzero(~region.closed)
    equal, positive = np.zeros((2, len(facts), count), dtype=bool)
    equal[equal_pairs(held, moving)] = True
    positive[:count] = pairs & ~region.closed & ~equal[:count]
    positive[count + 2] = ~region.closed
    lone = lone_faces(equal | positive, region.closed)
    positive[count : count + 2] = ~region.closed & (modes.hinges | ~np.repeat(lone, 4))
    space, velocities = space_of(modes, region, facts / largest[:, None], without(_even(statics)), lone)
    above = np.zeros(len(unit))
    above[-2:] = 1.0, -region.low
    goal = unit.T @ (np.outer(above, modes.live_rate) - slack * cost_of(modes)) / wide @ velocities.basis
    answer = minimise(ProductProgram(space, equal, positive, velocities.split(goal), velocities.groups), seconds)
    if answer is None:
        return None
    multipliers = Multipliers(
        wide * answer.multipliers / largest[:, None], np.zeros(count + 2), region.low + wide * answer.bound
    )
    return multipliers if answer.sure else None


class BlockCertifier(Certifier):
    """A certifier whose corrections are made by blocks as well; what counts as proven is the same."""

    def bound(self, multipliers: Multipliers, enough: float = math.inf) -> float:
        """The bound of multipliers, or one close to it, if it is proven; −inf if not. enough: not sought beyond."""
        found = -math.inf
        lone = lone_faces(multipliers.over != 0.0, self.region.closed)
        self.alone[-len(lone) :] = lone
        for self.least_free in _FREE:
            found = super().bound(multipliers, enough)
            if found > -math.inf:
                break
        return found

    def _correction(self, over: Floats, price: Floats) -> Any:
        largest = abs(self.facts * self.size).max(axis=1)
        share = np.where(self.free, 1.0, np.minimum(over * largest[:, None] / self.least_free, 1.0))
        share = np.where(share < _GONE / self.least_free, 0.0, share)
        share[:, self.region.closed] = 0.0
        lone = lone_faces(share > 0.0, self.region.closed)
        facts = clean(self.facts * self.size / largest[:, None])
        free_states = self.states / self.size[:, None]
        space, velocities = space_of(self.modes, self.region, facts, free_states, lone)
        weights = share**2
        solved = NormalEquations(space, share > 0.0, velocities.groups).factor(weights, 1.0, _SHIFT)

        def change(rest: Floats) -> tuple[BinaryFractions, BinaryFractions, BinaryFractions]:
            size = float(abs(rest).max(initial=0.0)) or 1.0
            left = velocities.split(self.size[:, None] * (rest / size) @ velocities.basis)
            point = solved(left, _EXACT, _REFINED)
            more, raised = weights * space.values(point), float((space.unit * point[0]).sum())
            more = np.asarray(more * (size / largest[:, None]), dtype=np.float64)
            tables = (more, np.zeros((len(price), 1)), np.array([[raised * size]]))
            one, two, three = (BinaryFractions.of(cut(table, 2 * BITS)) for table in tables)
            return one, two, three

        return change


def lone_faces(used: Bools, closed: Bools) -> Bools:
    """(m,) faces whose slides, both of which may move, are multiplied with their own slacks and 1 alone.

    used: (4m + 3, 4m) rows y, λ − L, U − λ, 1 times z that are there.
    """
    faces = len(closed) // 4
    other: Bools = np.any(used[: 4 * faces].reshape(faces, 4, faces, 4)[:, :, :, 2:], axis=(1, 3))
    np.fill_diagonal(other, False)
    bounded = used[4 * faces : -1].reshape(-1, faces, 4)[:, :, 2:].any(axis=(0, 2))
    return np.asarray(~other.any(axis=0) & ~bounded & ~closed.reshape(faces, 4)[:, 2:].any(axis=1))


@dataclass(frozen=True)
class Velocities:
    """Free velocities of a region: basis (3n + m, w) of those that move no closed mode, and how X is split by them.

    What bounds the slides of a lone face asks for its own forces alone, so that of its t there are four products
    (`own`, their rows of Φ, (f, 4)) in the column `at` (f,), and no equilibrium; of all others, `whole` (w,), there
    are all. On walls that takes a third of X away, and so far it never cost anything. states: (3m + 2, k) free ones.
    """

    basis: Floats
    states: Floats
    whole: Bools
    own: Ints
    at: Ints
    groups: Ints

    def split(self, form: Floats) -> Point:
        """A form (3m + 2, w) over (Z, T)."""
        return self.states.T @ form[:, self.whole], form[self.own, self.at[:, None]]

    def joined(self, point: Point) -> Floats:
        """(3m + 2, w) from (Z, T)."""
        x = np.zeros((len(self.states), self.basis.shape[1]))
        x[:, self.whole] = self.states @ point[0]
        x[self.own, self.at[:, None]] = point[1]
        return x


def space_of(
    modes: Modes, region: Region, facts: Floats, states: Floats, lone: Bools
) -> tuple[ProductSpace, Velocities]:
    """facts: (4m + 3, 3m + 2) as `extended`, states: (3m + 2, k) free ones, both of scaled Φ; lone: (m,)."""
    basis = without(modes.rates[region.closed])
    rates = modes.rates @ basis
    rates[abs(rates) < _NOTHING] = 0.0
    faces, count, width = np.flatnonzero(lone), len(modes.rows), len(modes.dead)
    at = np.array([np.flatnonzero(basis[width + face])[0] for face in faces], dtype=np.int64)
    whole = ~np.isin(np.arange(basis.shape[1]), at)
    own = np.column_stack([3 * faces, 3 * faces + 1, 3 * faces + 2, np.full(len(faces), len(states) - 1)])
    rows = np.column_stack([*(4 * faces + k for k in range(4)), np.full(len(faces), count + 2)])
    space = ProductSpace(
        facts=facts @ states,
        rates=rates[:, whole],
        lone=faces,
        own=facts[rows[:, :, None], own[:, None, :]],
        states=states[own],
        live=(modes.live_rate @ basis)[whole],
    )
    # velocities of one element together, each t by itself
    first = np.array([int(np.flatnonzero(column)[0]) for column in basis.T], dtype=np.int64)
    names = np.where(first < width, first // 3, first)[whole]
    return space, Velocities(basis, states, whole, own, at, np.unique(names, return_inverse=True)[1])


def _even(rows: Floats) -> Floats:
    return np.asarray(rows / abs(rows).max(axis=1)[:, None])
