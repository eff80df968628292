"""Run an experiment on one labelling: curve of λ over displacement, and collapse load."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from jld_core import Assembly, Bits, Floats, InputError, Ints, parameters
from jld_core import assembly as structures
from jld_experiment.bench import EnergyBalance
from jld_experiment.driving import push, scout
from jld_experiment.settings import ACCURACY, RATE_ERROR, Joints, Settings
from jld_experiment.specimen import Specimen, Standing, specimen_of


def require_one_load(assembly: Assembly) -> None:
    """Raise InputError if an assembly has load cases or members, which are not modelled.

    Parameters
    ----------
    assembly : Assembly
        The structure.

    Raises
    ------
    InputError
        If it has load cases or members.
    """
    assembly.members.refuse("an experiment")
    if assembly.cases:
        problem = f"an experiment pushes with one live load, and there are {len(assembly.cases)} cases"
        raise InputError("loads.cases", problem, '"loads.live" with the load of one of them')


@dataclass(frozen=True)
class Curve:
    """Result of an experiment; arrays are empty if the dead loads alone cause collapse.

    Attributes
    ----------
    assembly, labels, joints, settings
        As given.
    standing : Standing
        Behaviour under the dead loads alone.
    reach : float
        Displacement (live·u, scene units) of the elastic structure at λ = 1.
    collapse_load : float
        λ at collapse.
    rising : bool
        True if the load neither fell nor reached a plateau.
    at_collapse, at_end : (n, q) float array
        Displacements since the dead loads rested.
    cracked : (m,) float array
        Broken share of the area of each face at the end.
    distance, load_factor, unbalanced, energy_error : (k,) float array
        Displacement, λ, unbalanced force over the largest dead load, and `EnergyBalance.error` of the slower push.
    broken : (k,) int array
        Its broken sub-contacts.
    faster : (k', 2) float array
        Displacement and λ of the faster push.
    collapse : int
        Record of the collapse load.
    rate_error : float
        Relative difference of both collapse loads.
    first_crack : float
        λ at which a brittle face first broke, or NaN.
    periods : float
        Duration of both pushes, slowest periods.
    energy_at_collapse, energy : EnergyBalance or None
        Up to the collapse load, and to the end of the slower push.
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
    energy_error: Floats = field(default_factory=lambda: np.zeros(0))
    energy_at_collapse: EnergyBalance | None = None
    energy: EnergyBalance | None = None

    @property
    def stands(self) -> bool:
        """True if the structure stands under the dead loads."""
        return self.standing is Standing.RESTS

    @property
    def rates_agree(self) -> bool:
        """True if two rates give the same collapse load within `RATE_ERROR`; no bound on λ."""
        return self.stands and not self.rising and self.rate_error <= RATE_ERROR

    @property
    def accuracy(self) -> float:
        """Relative accuracy of the collapse load: the rate error, at least `ACCURACY`."""
        return max(self.rate_error, ACCURACY)


@parameters.typed
def run_experiment(
    assembly: Assembly,
    labels: Bits | None = None,
    *,
    joints: Joints | None = None,
    settings: Settings | None = None,
) -> Curve:
    """Load one labelling of an assembly until collapse, twice, at two rates.

    The assembly settles under its dead loads; then live·u grows at a constant rate, and λ is its multiplier.

    Parameters
    ----------
    assembly : Assembly
        Structure with one live load.
    labels : (m,) bool array, optional
        Default: the scene's own.
    joints : Joints, optional
        Laws of the joints.
    settings : Settings, optional
        The settings.

    Returns
    -------
    Curve
        With the collapse load of the slower push.

    Raises
    ------
    InputError
        If a material is missing, a setting is invalid, or there are load cases.
    """
    require_one_load(assembly)
    own = structures.labels_of(assembly, labels)
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
        energy_error=slow.energy_error,
        energy_at_collapse=specimen.energy(slow.at_collapse),
        energy=specimen.energy(slow.at_end),
    )


def _nothing(specimen: Specimen, joints: Joints, standing: Standing, moved: Floats, rising: bool = False) -> Curve:
    """Return the curve of a structure that is not pushed: it falls, has no strength or is locked."""
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
