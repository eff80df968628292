"""Repair partitions that break a limit, with small random changes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import inf

from jld_core.deadline import checkpoint
from jld_explore.drivers.operators.atom_graph import AtomGraph, BufferedRandom, PartLimits, Parts, Seams
from jld_explore.drivers.operators.cutting import Cutter

_TRIES = 4  # random cuts tried of one region before it is enlarged, and number of enlargements


class Repair:
    """Algorithm that repairs partitions of the atoms of one search space."""

    def __init__(self, graph: AtomGraph, limits: PartLimits, cutter: Cutter) -> None:
        self.graph, self.limits, self.cutter = graph, limits, cutter
        self._counted_parts = limits.parts != (-inf, inf)

    @property
    def counted(self) -> bool:
        """True if the number of parts or of dry faces is limited."""
        return self._counted_parts or bool(self.limits.seams)

    def __call__(self, part: Parts, rng: BufferedRandom, unchecked: list[int] | None = None) -> Parts | None:
        """Return a partition near a given one that keeps every limit, or None; `unchecked`: parts to check."""
        groups = Groups(self.graph, self.cutter, part, unchecked)
        for _ in range(6 + len(self.graph) // 2):
            checkpoint()
            violating_part = groups.violating_part()
            if violating_part is not None:
                if not self._repair_part(groups, violating_part, rng):
                    return None
                continue
            fault = self._fault(groups)
            if fault is None:
                return groups.part
            if not fault(groups, rng):
                return None
        return None

    def _fault(self, groups: Groups) -> Callable[[Groups, BufferedRandom], bool] | None:
        """Return the method that corrects the first violated limit on numbers, or None."""
        # The numbers are those of parts and of dry faces.
        numbers = [(groups.count(), *self.limits.parts)] if self._counted_parts else []
        numbers += [(groups.dry(seams), least, most) for seams, least, most in self.limits.seams]
        for number, least, most in numbers:
            if number > most:
                return self._join
            if number < least:
                return self._divide
        return None

    def _repair_part(self, groups: Groups, violating_part: int, rng: BufferedRandom) -> bool:
        """Replace a part that breaks a limit by allowed ones, made with its neighbours."""
        members = groups[violating_part]
        if self.cutter.fits(members):
            for other in rng.shuffled(groups.around([violating_part])):
                if self.cutter.fits(members + groups[other]):
                    groups.replace([violating_part, other], [members + groups[other]])
                    return True
        region = [violating_part]
        for _ in range(_TRIES):
            checkpoint()
            if self._recut(groups, region, rng, lambda pieces: True):
                return True
            around = groups.around(region)
            if not around:
                return False
            region.append(rng.pick(around))
        return False

    def _recut(
        self, groups: Groups, region: list[int], rng: BufferedRandom, wanted: Callable[[list[list[int]]], bool]
    ) -> bool:
        """Cut the union of some parts anew into allowed parts that `wanted` accepts."""
        members = [a for name in region for a in groups[name]]
        for _ in range(_TRIES):
            checkpoint()
            pieces = self.cutter.cut(members, rng, rng.real())
            if pieces is None or not all(self.cutter.large_enough(piece) for piece in pieces):
                continue
            if all(self.cutter.fits(piece) for piece in pieces) and wanted(pieces):
                groups.replace(region, pieces)
                return True
        return False

    def _join(self, groups: Groups, rng: BufferedRandom) -> bool:
        """Reduce the number of parts or of dry faces; return False if that fails."""
        names = rng.shuffled(list(groups))
        for name in names:
            for other in rng.shuffled(groups.around([name])):
                if self.cutter.fits(groups[name] + groups[other]):
                    groups.replace([name, other], [groups[name] + groups[other]])
                    return True
        return self._regroup(groups, names, rng, lambda before, after: after < before)

    def _divide(self, groups: Groups, rng: BufferedRandom) -> bool:
        """Increase the number of parts or of dry faces; return False if that fails."""
        names = rng.shuffled(list(groups))
        for name in names:
            if len(groups[name]) > 1 and self._recut(groups, [name], rng, lambda pieces: len(pieces) > 1):
                return True
        return self._regroup(groups, names, rng, lambda before, after: after > before)

    def _regroup(
        self, groups: Groups, names: list[int], rng: BufferedRandom, better: Callable[[int, int], bool]
    ) -> bool:
        """Cut two to four neighbours anew so that the number of parts or dry faces improves."""
        for name in names[: 2 * _TRIES]:
            region = [name]
            while len(region) < 4:
                around = groups.around(region)
                if not around:
                    break
                region.append(rng.pick(around))
                before, dry = len(region), groups.dry()

                def wanted(pieces: list[list[int]], before: int = before, dry: int = dry) -> bool:
                    if better(before, len(pieces)):
                        return True
                    return len(pieces) == before and better(dry, groups.dry_after(pieces))

                if self._recut(groups, region, rng, wanted):
                    return True
        return False


class Groups:
    """Partition under construction: the atoms of each part by its name, an integer."""

    def __init__(self, graph: AtomGraph, cutter: Cutter, part: Parts, unchecked: list[int] | None) -> None:
        self.graph, self.cutter = graph, cutter
        self._members: dict[int, list[int]] = {}
        for a, name in enumerate(part):
            if name in self._members:
                self._members[name].append(a)
            else:
                self._members[name] = [a]
        names_to_check = list(self._members) if unchecked is None else [n for n in unchecked if n in self._members]
        self._unchecked: dict[int, None] = dict.fromkeys(names_to_check)
        self.part = list(part)
        self._next = max(part) + 1
        for name in names_to_check:
            pieces = cutter.components(self._members[name])
            if len(pieces) > 1:
                self.replace([name], pieces)

    def __iter__(self) -> Iterator[int]:
        return iter(self._members)

    def __getitem__(self, name: int) -> list[int]:
        return self._members[name]

    def replace(self, old: list[int], new: list[list[int]]) -> None:
        """Replace the parts named `old` by new ones, lists of atoms, which get new names."""
        # New parts count as unchecked.
        for name in old:
            del self._members[name]
            self._unchecked.pop(name, None)
        for members in new:
            self._members[self._next] = members
            self._unchecked[self._next] = None
            for a in members:
                self.part[a] = self._next
            self._next += 1

    def violating_part(self) -> int | None:
        """Return the name of a part that breaks a limit on single parts, or None."""
        while self._unchecked:
            name = next(iter(self._unchecked))
            members = self._members[name]
            if not (self.cutter.fits(members) and self.cutter.large_enough(members)):
                return name
            del self._unchecked[name]
        return None

    def around(self, region: list[int]) -> list[int]:
        """Return the names of the parts that touch a region through candidate faces."""
        part, links = self.part, self.graph.links
        found = {part[b]: None for name in region for a in self._members[name] for b, _ in links[a]}
        for name in region:
            found.pop(name, None)
        return list(found)

    def count(self) -> int:
        """Return the number of parts with a free element."""
        cells = self.graph.cells
        return sum(1 for members in self._members.values() if any(cells[a] for a in members))

    def dry(self, seams: Seams | None = None) -> int:
        """Return the number of dry faces, without slits, among some seams; None: all seams."""
        part = self.part
        return sum([number for a, b, number in (self.graph.seams if seams is None else seams) if part[a] != part[b]])

    def dry_after(self, pieces: list[list[int]]) -> int:
        """Return the number of dry faces between free elements if a region were cut into pieces."""
        part = list(self.part)
        for number, piece in enumerate(pieces):
            for a in piece:
                part[a] = -1 - number
        return sum([number for a, b, number in self.graph.seams if part[a] != part[b]])
