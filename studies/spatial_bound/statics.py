"""Bounds on spatial forces with λ in an interval, and on velocities per unit of cost.

The bounds follow from equilibrium and yield conditions.
"""

from __future__ import annotations

from functools import cached_property
from typing import Final

import numpy as np

from jld_core.arrays import Bools, Floats, Ints
from jld_core.models.zero_dilation.statics import Statics
from studies.spatial_bound.modes import SpaceModes, widest

_LEAST: Final = 1e-6
"""Least scaled friction that proves that friction is mobilised."""

_SAME: Final = 1e-9
"""Relative part of a motion that counts as zero."""

_DRIFT: Final = 1e-3
"""Limit of the bound that may be lost to such parts."""


class SpaceStatics(Statics):
    """`Statics` of spatial resultants under polygons of friction.

    The polygons contain the true friction circles, so the bounds hold for the true forces.
    """

    def __init__(
        self, modes: SpaceModes, low: float, high: float, held: Bools, force_bounds: Floats | None = None
    ) -> None:
        super().__init__(modes, low, high, held, force_bounds)
        self.space = modes

    @cached_property
    def force_bounds(self) -> Floats:
        """Return (q + 2,) upper bounds on |F|, |λ| and 1; inf where self-stress is unbounded.

        The sum S of all slacks bounds N + σtA, |m| / extent, |V1|, |V2| and |mT| of every face, and therefore itself.
        """
        if self._force_bounds is not None:
            return self._force_bounds
        modes = self.space
        grows, stands = np.zeros((2, modes.rows.shape[1]))
        for face, columns in enumerate(modes.columns):
            n, one, two, *moments, twist = columns
            grows[n], stands[n] = 1.0, modes.tension[face]
            for column in (one, two, twist, modes.share[face]):
                grows[column] = 1.0 if column >= 0 else grows[column]
            for column in moments:
                grows[column] = modes.extent[face] if column >= 0 else grows[column]
        total = -np.append(modes.rows.sum(axis=0), [0.0, modes.constants.sum()])
        value, left = self._bound(total)
        missed = float(left @ grows)
        force_bounds = np.full(len(total), np.inf)
        force_bounds[-2:] = max(abs(self.low), abs(self.high)), 1.0
        if not np.isfinite(value) or missed > 0.5:
            return force_bounds
        most = (float(left @ stands) - value) / (1.0 - missed)
        force_bounds[:-2] = most * grows + stands
        coarse = force_bounds.copy()
        for face, columns in enumerate(modes.columns):
            n, one, two, *moments, twist = columns
            pressed = np.zeros(len(total))
            pressed[n] = -1.0
            value, left = self._bound(pressed)
            most = -(value - float(left @ coarse[:-2]))
            strong = modes.tension[face]
            holds = float(modes.capacities[face, n]) * max(most, 0.0) + float(modes.capacities[face, -1])
            ends = {n: max(most, strong)}
            ends |= dict.fromkeys((one, two, twist, modes.share[face]), holds)
            ends |= dict.fromkeys(moments, modes.extent[face] * (most + strong))
            for column, end in ends.items():
                if column >= 0:
                    force_bounds[column] = min(end, coarse[column])
        return force_bounds

    def closed_modes(self) -> Bools:
        """Return a mask (l,) of modes that cannot move.

        A bending mode cannot move if y > 0 in every state, and a slide if no state reaches the friction circle.
        """
        modes = self.space
        rubs = np.flatnonzero(modes.slip >= 0)
        inside = [self._inside(face) for face in rubs.tolist()]
        forms = np.vstack([modes.slacks[: modes.bending], *inside])
        asked = np.concatenate([~self.held[: modes.bending], np.ones(len(forms) - modes.bending, dtype=bool)])
        sure = self.proven_positive(forms, asked)
        kept = np.split(sure[modes.bending :], np.cumsum([len(table) for table in inside])[:-1]) if inside else []
        stuck = np.zeros(modes.faces, dtype=bool)
        stuck[rubs] = [bool(own.all()) for own in kept]
        found = np.asarray(stuck[modes.mode_face])
        found[: modes.bending] = sure[: modes.bending]
        return found

    def _inside(self, face: int) -> Floats:
        """Return forms of (F, λ, 1) that are all positive only if |V| + |mT| < C.

        They use |V| ≤ max d·V / cos(half the widest angle between directions).
        """
        modes = self.space
        one, two, twist = modes.columns[face, [1, 2, 5]]
        narrow = np.cos(0.5 * widest(modes.directions[face]))
        table = []
        for d in modes.directions[face]:
            for sign in (1.0, -1.0) if twist >= 0 else (0.0,):
                row = narrow * modes.capacities[face]
                row[one], row[two] = -d[0], -d[1]
                if twist >= 0:
                    row[twist] = -sign * narrow
                table.append(row)
        return np.array(table)


def bound_space_velocities(statics: SpaceStatics) -> Floats | None:
    """Return bounds (w,) on |u|, z and t per unit of the cost of a mechanism, or None.

    The cost is Σ z + Σ_f C |slip|. It bounds all z, and these bound openings and rotations. Motions that slide without
    opening are bounded one after another: where faces slide or twist together, and the friction between them cannot
    vanish, the motion costs at least that friction, minus what motions bounded already may contribute. Return None if
    the bounds are not proven.
    """
    modes = statics.space
    width = len(modes.dead)
    if not np.isfinite(statics.force_bounds).all():
        return None
    jumps = modes.matrix.T
    opening, ends = [], []
    for columns in modes.columns:
        for resultant in (0, 3, 4):
            if columns[resultant] >= 0:
                opening.append(jumps[columns[resultant]])
                own = modes.ties[_tie_of(modes, int(columns[resultant]))]
                ends.append(float(abs(own[modes.rows.shape[1] :]).max()))
    known, limits = np.array(opening), np.array(ends)
    capacity = abs(modes.capacities) @ statics.force_bounds
    rubs = np.flatnonzero(modes.slip >= 0)
    drift = 0.0
    # Twists come first: once they are bounded, faces in one plane slide alike.
    for resultant in (5, 1, 2):
        for first in rubs.tolist():
            if modes.columns[first, resultant] < 0:
                continue
            way = jumps[modes.columns[first, resultant]]
            back = np.linalg.pinv(known, rcond=1e-10)
            rest = way - way @ back @ known
            if np.linalg.norm(rest) <= _SAME * max(float(np.linalg.norm(way)), 1.0):
                continue
            norm = float(np.linalg.norm(rest))
            weight, others, errors = np.zeros(modes.faces), 0.0, 0.0
            for face in rubs.tolist():
                like = _most_like(jumps, modes.columns[face, [1, 2, 5]], rest / norm, back, known)
                if like is None:
                    continue
                share, slip = like[0] / norm, like[1]
                taken = slip @ back - share * (way @ back)
                error = abs(slip - share * way - taken @ known).sum()
                weight[face] = share
                others += float(capacity[face]) * float(abs(taken) @ limits)
                errors += float(capacity[face]) * float(error)
            least = statics.least(weight @ modes.capacities)
            if not least > _LEAST:
                continue
            known, limits = np.vstack([known, way]), np.append(limits, (1.0 + others) / least)
            drift = max(drift, errors / least)
    back = np.linalg.pinv(known, rcond=1e-12)
    if abs(back @ known - np.eye(width)).sum(axis=1).max() > _SAME:
        return None
    # The factor 2 covers rounding, which the test below keeps small.
    velocity = 2.0 * abs(back) @ limits
    if drift * float(velocity.max(initial=0.0)) > _DRIFT:
        return None
    slips = abs(modes.motions) @ np.concatenate([velocity, np.zeros(modes.motions.shape[1] - width)])
    velocity_bounds = np.concatenate([velocity, np.ones(modes.bending), np.zeros(len(rubs))])
    for place, face in enumerate(rubs.tolist()):
        one, two, twist = modes.columns[face, [1, 2, 5]]
        turn = float(slips[twist]) if twist >= 0 else 0.0
        velocity_bounds[width + modes.bending + place] = max(float(np.hypot(slips[one], slips[two])), turn)
    return velocity_bounds


def _tie_of(modes: SpaceModes, column: int) -> int:
    """Return the tie of an opening or a rotation."""
    return int(np.flatnonzero(modes.ties[:, column])[0])


def _most_like(jumps: Floats, columns: Ints, unit: Floats, back: Floats, known: Floats) -> tuple[float, Floats] | None:
    """Return the slip or twist of a face most similar to a unit motion, up to known motions.

    columns: of V1, V2 and mT, −1 if absent. The result is the share of the unit motion and the slip or twist, None if
    the face has no such component.
    """
    best: tuple[float, Floats] | None = None
    for part in (columns[:2], columns[2:]):
        own = part[part >= 0]
        if not len(own):
            continue
        slips = jumps[own]
        rest = slips - slips @ back @ known
        rest[abs(rest) < _SAME] = 0.0
        mix = unit @ np.linalg.pinv(rest, rcond=1e-6)
        length = float(np.linalg.norm(mix))
        if length > 0.0 and np.linalg.norm(mix @ rest - unit) <= _SAME and (best is None or 1.0 / length > best[0]):
            best = 1.0 / length, (mix / length) @ slips
    return best
