"""Cut a region of the atom graph into allowed parts; operators on single labels, for searches that allow slits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from math import inf

import numpy as np

from jld_core.arrays import Bits, Floats, Ints
from jld_core.deadline import checkpoint
from jld_explore.drivers.operators.atom_graph import (
    AtomGraph,
    BufferedRandom,
    PartLimits,
    Parts,
    Seams,
    atom_graph,
    limits_of,
)
from jld_explore.space import feasible
from jld_explore.space.labelling import blocks_of
from jld_explore.space.limits import CELLS
from jld_explore.space.search_space import SearchSpace


class Cutter:
    """Algorithm that cuts regions, lists of atoms, into parts within the limits on single parts."""

    def __init__(self, graph: AtomGraph, limits: PartLimits) -> None:
        # A number for each pair of atoms, its key, decides: above the threshold it asks for a joint, by its distance.
        # Every segmentation results from some keys: low inside its parts and high between them.
        self.graph, self.limits = graph, limits
        self._walled = any(graph.walls)
        self.exact = limits.only_cells and not self._walled
        sized = graph.sized
        # bounds of each limit other than those on cells, and the contribution of each atom; None for the bounding box
        self._others = [
            (bounds, sized.adds[key].tolist() if key in sized.adds else None)
            for key, bounds in limits.sizes.items()
            if bounds.given and key != CELLS.key
        ]
        self._corner = sized.corner.tolist()
        self._least, self._most = least, most = limits.cells
        # without an upper limit, all numbers of cells above the lower limit are equivalent
        self._cap = int(most) if most < inf else least
        self._bounded = self._cap > 0

    def fits(self, members: list[int]) -> bool:
        """Return whether a part is within the upper limits and contains no wall."""
        cells, sink = self.graph.cells, self.limits.sink
        if sink is not None and sink.atom in members:
            return sink.takes(members)
        free = self._is_exempt(members)
        if not free and sum([cells[a] for a in members]) > self._most:
            return False
        if self.exact:
            return True
        if self._walled:
            inside = set(members)
            if any(other in inside for a in members for other in self.graph.walls[a]):
                return False
        return free or all(self._size(members, adds) <= bounds.most for bounds, adds in self._others)

    def large_enough(self, members: list[int]) -> bool:
        """Return whether a part is within the lower limits, is exempt, or has no free element."""
        cells = self.graph.cells
        count = sum([cells[a] for a in members])
        if count == 0 or self._is_exempt(members):
            return True
        if count < self._least:
            return False
        return all(self._size(members, adds) >= bounds.least for bounds, adds in self._others)

    def _is_exempt(self, members: list[int]) -> bool:
        return bool(self.limits.exempt) and any(a in self.limits.exempt for a in members)

    def _size(self, members: list[int], adds: list[float] | None) -> float:
        """Return the sum of a measure over a part, or the longest side of its bounding box."""
        if adds is not None:
            return sum([adds[a] for a in members])
        corner = [max(values) for values in zip(*[self._corner[a] for a in members], strict=True)]
        d = len(corner) // 2
        return float(max(corner[i] + corner[d + i] for i in range(d)))

    def components(self, members: list[int]) -> list[list[int]]:
        """Return the connected components of a set of atoms, each in breadth-first order."""
        unvisited, components = dict.fromkeys(members), []
        for start in members:
            if start not in unvisited:
                continue
            del unvisited[start]
            component = [start]
            for a in component:
                for b, _ in self.graph.links[a]:
                    if b in unvisited:
                        del unvisited[b]
                        component.append(b)
            components.append(component)
        return components

    def cut(self, members: list[int], rng: BufferedRandom, threshold: float) -> list[list[int]] | None:
        """Cut a region at random into connected parts; return None if no cut is allowed."""
        inside = set(members)
        keyed = [
            (rng.real(), number, a, b) for a in members for b, number in self.graph.links[a] if a < b and b in inside
        ]
        keyed.sort()
        return self.assemble(members, keyed, threshold)

    def assemble(
        self, members: list[int], keyed: list[tuple[float, int, int, int]], threshold: float
    ) -> list[list[int]] | None:
        """Cut a region into parts by keys (key, pair, a, b) in ascending order; None if not allowed."""
        # the tree takes pairs in ascending order of keys; dynamic programming over the cells of open parts then finds
        # the cuts that agree best with the keys
        if not self.exact:
            return self.grow(members, keyed, threshold)
        root = {a: a for a in members}
        tree: dict[int, list[tuple[int, float]]] = {a: [] for a in members}
        joints_left = len(members) - 1
        tried_parts = False
        for key, _, a, b in keyed:
            if key > threshold and not tried_parts:
                tried_parts = True
                parts = self._as_they_are(members, root)
                if parts is not None:
                    return parts
            p, q = a, b
            while root[p] != p:
                root[p] = p = root[root[p]]
            while root[q] != q:
                root[q] = q = root[root[q]]
            if p != q:
                root[p] = q
                tree[a].append((b, key - threshold))
                tree[b].append((a, key - threshold))
                joints_left -= 1
                if not joints_left:
                    break
        return self._cut_tree(members, tree)

    def _as_they_are(self, members: list[int], root: dict[int, int]) -> list[list[int]] | None:
        """Return the parts joined so far if all are allowed, else None."""
        # The parts joined so far cut exactly the pairs whose key exceeds the threshold.
        least, most = self._least, self._most
        cells = self.graph.cells
        parts: dict[int, list[int]] = {}
        for a in members:
            p = a
            while root[p] != p:
                root[p] = p = root[root[p]]
            if p in parts:
                parts[p].append(a)
            else:
                parts[p] = [a]
        for part in parts.values():
            count = sum([cells[a] for a in part])
            if count > most or 0 < count < least:
                return None
        return list(parts.values())

    def grow(self, members: list[int], keyed: list[tuple[float, int, int, int]], threshold: float) -> list[list[int]]:
        """Join parts in ascending order of keys where the union `fits`; some may remain too small."""
        # Pairs whose key exceeds the threshold stay apart. Arguments are as in `assemble`.
        name = {a: a for a in members}
        parts = {a: [a] for a in members}
        for key, _, a, b in keyed:
            if key > threshold:
                break
            p, q = name[a], name[b]
            if p != q and self.fits(parts[p] + parts[q]):
                for c in parts[q]:
                    name[c] = p
                parts[p] += parts.pop(q)
        return list(parts.values())

    def _cut_tree(self, members: list[int], tree: dict[int, list[tuple[int, float]]]) -> list[list[int]] | None:
        """Cut a forest into allowed parts at the least cost; return None if there is no way."""
        parent_of: dict[int, tuple[int, float]] = {}
        order: list[int] = []
        roots: list[int] = []
        for start in members:
            if start in parent_of:
                continue
            parent_of[start] = (-1, 0.0)
            roots.append(start)
            queue = [start]
            for a in queue:
                for b, worth in tree[a]:
                    if b not in parent_of:
                        parent_of[b] = (a, worth)
                        queue.append(b)
            order += queue
        joined: dict[int, bool] = {}
        if self._bounded:
            if not self._choose(order, parent_of, joined):
                return None
        else:
            joined = {a: parent_of[a][1] <= 0.0 for a in order}
        parts: list[list[int]] = []
        part_of: dict[int, list[int]] = {}
        for a in order:
            parent = parent_of[a][0]
            if parent >= 0 and joined[a]:
                part_of[a] = part_of[parent]
                part_of[a].append(a)
            else:
                part_of[a] = [a]
                parts.append(part_of[a])
        return parts

    def _choose(self, order: list[int], parent_of: dict[int, tuple[int, float]], joined: dict[int, bool]) -> bool:
        """Decide for each atom of a forest whether it stays with its parent; False if impossible."""
        # Dynamic programming from the leaves: least cost by the number of cells of the part that is still open at an
        # atom. An atom closes its part there, or leaves it open to its parent's.
        cap, least = self._cap, self._least
        capped = self._most == inf  # without a largest size all counts from `cap` on are alike
        cells = self.graph.cells
        table: dict[int, dict[int, float]] = {}
        steps: dict[int, dict[int, tuple[int, int]]] = {}  # counts before and of the child, −1 where it closes
        close: dict[int, int] = {}  # count at which a part is best closed at an atom, −1 if at none
        for a in order:
            count = cells[a]
            if count > cap:
                if not capped:
                    return False
                count = cap
            table[a] = {count: 0.0}
        for a in reversed(order):
            costs = table[a]
            closing_cost, closing_cells = inf, -1
            for cells_open, cost in costs.items():
                if (cells_open >= least or cells_open == 0) and cost < closing_cost:
                    closing_cost, closing_cells = cost, cells_open
            close[a] = closing_cells
            parent, worth = parent_of[a]
            if parent < 0:
                if closing_cells < 0:
                    return False
                continue
            new_costs: dict[int, float] = {}
            new_steps: dict[int, tuple[int, int]] = {}
            for before, cost in table[parent].items():
                if closing_cells >= 0:
                    total = cost + closing_cost - worth
                    if total < new_costs.get(before, inf):
                        new_costs[before] = total
                        new_steps[before] = (before, -1)
                for child, cost_of_child in costs.items():
                    after = before + child
                    if after > cap:
                        if not capped:
                            continue
                        after = cap
                    total = cost + cost_of_child
                    if total < new_costs.get(after, inf):
                        new_costs[after] = total
                        new_steps[after] = (before, child)
            if not new_costs:
                return False
            table[parent], steps[a] = new_costs, new_steps
        # read the decisions back: children joined their parent in reverse order, so they are removed in this order
        state: dict[int, int] = {}
        for a in order:
            parent = parent_of[a][0]
            if parent < 0:
                state[a] = close[a]
                continue
            before, child = steps[a][state[parent]]
            state[parent] = before
            joined[a] = child >= 0
            state[a] = child if child >= 0 else close[a]
        return True


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
        self, groups: Groups, region: list[int], rng: BufferedRandom, accepts: Callable[[list[list[int]]], bool]
    ) -> bool:
        """Cut the union of some parts anew into allowed parts that pass `accepts`."""
        members = [a for name in region for a in groups[name]]
        for _ in range(_TRIES):
            checkpoint()
            pieces = self.cutter.cut(members, rng, rng.real())
            if pieces is None or not all(self.cutter.large_enough(piece) for piece in pieces):
                continue
            if all(self.cutter.fits(piece) for piece in pieces) and accepts(pieces):
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

                def accepts(pieces: list[list[int]], before: int = before, dry: int = dry) -> bool:
                    if better(before, len(pieces)):
                        return True
                    return len(pieces) == before and better(dry, groups.dry_after(pieces))

                if self._recut(groups, region, rng, accepts):
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
        neighbours = {part[b]: None for name in region for a in self._members[name] for b, _ in links[a]}
        for name in region:
            neighbours.pop(name, None)
        return list(neighbours)

    def count(self) -> int:
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


class FreeBits:
    """Operators on the labellings of a search space that allows slits."""

    offspring_factor = 2
    always_feasible = False

    def __init__(self, space: SearchSpace) -> None:
        self.space = space
        self.graph = atom_graph(space)
        self.limits = limits_of(space, self.graph)
        # Slits can supply dry faces that are missing between blocks, as far as each block stays connected.
        on_faces = [(terms.faces, bounds) for terms, bounds in space.limits.on_terms if terms.faces is not None]
        may_be_dry = space.candidates | space.fixed
        spare = [bounds.least - int((faces & may_be_dry).sum()) + len(self.graph) for faces, bounds in on_faces]
        fewest, greatest = self.limits.parts
        seams = tuple((seams, -inf, most) for seams, _, most in self.limits.seams)
        on_blocks = replace(self.limits, seams=seams, parts=(max(fewest, *spare, -inf), greatest))
        self._repair = Repair(self.graph, on_blocks, Cutter(self.graph, on_blocks))
        self._faces = np.flatnonzero(space.candidates).tolist()
        self._ends = list(zip(self.graph.face_a.tolist(), self.graph.face_b.tolist(), strict=True))
        self._counted = [(faces.tolist(), bounds) for faces, bounds in on_faces]
        self.keys = len(self._faces)

    def draw(self, count: int, rng: BufferedRandom) -> Bits:
        # each labelling has its own share of dry faces
        rows = np.repeat(self.space.fixed[None], count, axis=0)
        for row in rows:
            share = rng.real()
            row[self._faces] = [key < share for key in rng.reals(self.keys)]
        return self._repaired(rows, rng)

    def vary(self, parents: Bits, rng: BufferedRandom) -> Bits:
        """Return parents with one or more random faces flipped, made feasible."""
        rows = parents.copy()
        for row in rows:
            face = rng.pick(self._faces)
            row[face] = not row[face]
            while rng.real() < 0.35:
                face = rng.pick(self._faces)
                row[face] = not row[face]
        return self._repaired(rows, rng)

    def cross(self, first: Bits, second: Bits, rng: BufferedRandom) -> Bits:
        rows = first.copy()
        for row, other in zip(rows, second, strict=True):
            take = [face for face in self._faces if rng.real() < 0.5]
            row[take] = other[take]
        return self._repaired(rows, rng)

    def cross_indexed(self, first: Bits, second: Bits, rng: BufferedRandom) -> tuple[Bits, Ints]:
        rows = [self.cross(parent[None], partner[None], rng) for parent, partner in zip(first, second, strict=True)]
        return np.concatenate([first[:0], *rows]), np.repeat(np.arange(len(rows)), [len(row) for row in rows])

    def read(self, keys: Floats, *, repair: bool = True) -> tuple[Bits, Ints]:
        rows = np.repeat(self.space.fixed[None], len(keys), axis=0)
        rows[:, self._faces] = keys > 0.5
        seeds = [np.random.default_rng(np.frombuffer(key.tobytes(), dtype=np.uint32)) for key in keys]
        parts = [self._repaired(row[None], BufferedRandom(seed)) for row, seed in zip(rows, seeds, strict=True)]
        return np.concatenate([rows[:0], *parts]), np.repeat(np.arange(len(parts)), [len(part) for part in parts])

    def write(self, labellings: Bits) -> Floats:
        return np.where(labellings[:, self._faces], 0.75, 0.25)

    def breed(self, first: Bits, second: Bits, single: Bits, rng: BufferedRandom) -> Bits:
        return np.concatenate([self.cross(first, second, rng), self.vary(single, rng)])

    def _repaired(self, rows: Bits, rng: BufferedRandom) -> Bits:
        """Return rows made feasible; those that cannot be are left out."""
        inside = feasible(self.space, rows)
        if inside.all():
            return rows
        parts: list[Parts] = blocks_of(self.space.graph, rows)[:, self.graph.first].tolist()
        repaired = [
            row if fine else self._repair_part(row, part, rng)
            for row, part, fine in zip(rows, parts, inside.tolist(), strict=True)
        ]
        labellings = [row for row in repaired if row is not None]
        candidates = np.array(labellings, dtype=bool).reshape(len(labellings), rows.shape[1])
        return candidates[feasible(self.space, candidates)]

    def _repair_part(self, row: Bits, part: Parts, rng: BufferedRandom) -> Bits | None:
        # limits refer to blocks, which inner faces determine: blocks are changed first, labels inside keep their values
        # as far as each block stays connected
        repaired = self._repair(part, rng)
        if repaired is None:
            return None
        root = list(range(len(self.graph)))

        def find(a: int) -> int:
            while root[a] != a:
                root[a] = a = root[root[a]]
            return a

        child = row.copy()
        inside: list[int] = []
        bridges: set[int] = set()
        for face in self._faces:
            a, b = self._ends[face]
            child[face] = child[face] or repaired[a] != repaired[b]
            if repaired[a] == repaired[b]:
                inside.append(face)
        # Fixed inner faces lie inside atoms. Inner faces of the row come first, then faces needed to connect each
        # block.
        for face in sorted(rng.shuffled(inside), key=lambda f: bool(row[f])):
            p, q = (find(a) for a in self._ends[face])
            if p != q:
                root[p] = q
                bridges.add(face)
                child[face] = False
        order = rng.shuffled(inside)
        for counted, bounds in self._counted:
            dry = sum(1 for face, counts in enumerate(counted) if counts and child[face])
            for face in [face for face in order if counted[face] and face not in bridges]:
                if dry > bounds.most and child[face]:
                    child[face], dry = False, dry - 1
                elif dry < bounds.least and not child[face]:
                    child[face], dry = True, dry + 1
        return child
