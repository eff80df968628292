"""One assembly, one labelling → the curve of λ over the movement of the live loads, and its collapse load."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from jld_core import Assembly
from jld_core.arrays import Bits, Floats, Ints
from jld_core.errors import InputError
from jld_experiment.driving import push, scout
from jld_experiment.settings import ACCURACY, RATE_ERROR, Joints, Settings
from jld_experiment.specimen import Specimen, Standing, specimen_of


def require_one_load(assembly: Assembly) -> None:
    """Raise InputError for load cases: what is loaded until it comes down is loaded one way."""
    if assembly.cases:
        problem = f"an experiment pushes with one live load, and there are {len(assembly.cases)} cases"
        raise InputError("loads.cases", problem, '"loads.live" with the load of one of them')


@dataclass(frozen=True)
class Curve:
    """What an experiment showed.

    standing: under the dead loads alone. distance, load_factor, unbalanced: (k,) of the slower push: live·u in scene
    units (work of the live loads at λ = 1), λ, and the largest out-of-balance force over the largest dead load on
    an element. faster: (k', 2) distance and λ of the faster push. reach: live·u at λ = 1 if nothing yields.
    collapse: record of the collapse load, the largest λ before the first fall by a tenth of the highest. rising:
    had nothing given way when the push ended? at_collapse, at_end: (n, q) movements since the dead loads stood.
    cracked: (m,) share of the area of each face that had broken in the end. first_crack: λ at which a brittle face
    first gave way, NaN where none did. Arrays are empty where the dead loads alone bring it down.
    """

    assembly: Assembly
    labels: Bits
    joints: Joints
    settings: Settings
    standing: Standing
    reach: float
    collapse_load: float
    rising: bool
    at_collapse: Floats
    at_end: Floats
    cracked: Floats
    distance: Floats = field(default_factory=lambda: np.zeros(0))
    load_factor: Floats = field(default_factory=lambda: np.zeros(0))
    unbalanced: Floats = field(default_factory=lambda: np.zeros(0))
    broken: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    faster: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    collapse: int = 0
    rate_error: float = 0.0
    first_crack: float = np.nan
    periods: float = 0.0

    @property
    def stands(self) -> bool:
        """Does it stand under the dead loads?"""
        return self.standing is Standing.RESTS

    @property
    def rates_agree(self) -> bool:
        """Did two rates give the same collapse load, to RATE_ERROR? That is no bound on λ: see `accuracy`."""
        return self.stands and not self.rising and self.rate_error <= RATE_ERROR

    @property
    def certified(self) -> bool:
        """The former name of `rates_agree`, kept for one version: nothing is proven by an experiment."""
        return self.rates_agree

    @property
    def accuracy(self) -> float:
        """Relative accuracy that the collapse load can claim: the difference of two rates, ACCURACY at least."""
        return max(self.rate_error, ACCURACY)


def run_experiment(
    assembly: Assembly,
    labels: Bits | None = None,
    *,
    joints: Joints | None = None,
    settings: Settings | None = None,
) -> Curve:
    """Load one labelling of an assembly until it comes down, twice, at two rates.

    assembly: planar or spatial. labels: (m,) True dry; default the scene's own. The assembly is settled under its dead
    loads, then live·u is made to grow at a constant rate and λ is read off as the multiplier of that constraint. The
    collapse load comes from the slower push, `rate_error` is the relative difference of the two.
    Raises InputError where a material that the labelling needs is missing, a setting is of no use, or there are load
    cases.
    """
    require_one_load(assembly)
    own = assembly.labels if labels is None else np.asarray(labels, dtype=bool)
    joints, settings = joints or Joints(), settings or Settings()
    specimen = specimen_of(assembly, own, joints, settings)
    settled, standing = specimen.settle()
    if standing is not Standing.RESTS:
        return _nothing(specimen, joints, standing, settled.moved)
    scale = scout(specimen, settled)
    if not 0.0 < scale < np.inf:
        return _nothing(specimen, joints, standing, settled.moved, rising=scale > 0.0)
    fast = push(specimen, settled, scale, settings.periods)
    slow = push(specimen, settled, scale, settings.periods * settings.slower)
    found = slow.load_factor[slow.collapse]
    area = specimen.points.place[:, -1]
    broken = np.bincount(specimen.points.face, weights=area * slow.at_end.broken, minlength=len(own))
    first = np.flatnonzero(slow.broken > int(settled.broken.sum()))
    return Curve(
        assembly=assembly,
        labels=own,
        joints=joints,
        settings=settings,
        standing=standing,
        distance=slow.distance,
        load_factor=slow.load_factor,
        unbalanced=slow.unbalanced,
        broken=slow.broken,
        faster=np.column_stack([fast.distance, fast.load_factor]),
        reach=specimen.system.reach,
        collapse=slow.collapse,
        collapse_load=float(found),
        rate_error=float(abs(fast.load_factor[fast.collapse] / found - 1.0)),
        rising=fast.rising or slow.rising,
        at_collapse=slow.at_collapse.moved - settled.moved,
        at_end=slow.at_end.moved - settled.moved,
        cracked=broken / assembly.interfaces.area,
        first_crack=float(slow.load_factor[max(first[0] - 1, 0)]) if first.size else np.nan,
        periods=fast.periods + slow.periods,
    )


def _nothing(specimen: Specimen, joints: Joints, standing: Standing, moved: Floats, rising: bool = False) -> Curve:
    """A curve without a push: it does not stand, has no strength at all, or nothing in it can give way."""
    load = 0.0 if standing is Standing.RESTS and not rising else np.nan
    return Curve(
        assembly=specimen.assembly,
        labels=specimen.labels,
        joints=joints,
        settings=specimen.settings,
        standing=standing,
        reach=specimen.system.reach,
        collapse_load=load,
        rising=rising,
        at_collapse=moved,
        at_end=moved,
        cracked=np.zeros(len(specimen.labels)),
    )
