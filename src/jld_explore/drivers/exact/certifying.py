"""Write the proof of a bound as a certificate that `jld_explore.verification` checks."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from pysat.solvers import Solver

from jld_core._version import __version__
from jld_core.arrays import Bits, Bools, Floats
from jld_core.errors import ParameterError
from jld_core.limit import load_scale
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.block_relaxation import BlockMechanism as ScaledBlockMechanism
from jld_core.limit.block_relaxation import BlockRelaxation, applies_to
from jld_core.limit.case_relaxation import relaxation_of
from jld_core.limit.options import SolveOptions
from jld_core.scene.schema import Scene
from jld_core.solvers import make_solver
from jld_explore.drivers.base import Driver
from jld_explore.drivers.exact.conflict_generation import conflict_of
from jld_explore.drivers.exact.context import BlockTables, PossibleBlocks
from jld_explore.drivers.exact.driver import Exact
from jld_explore.drivers.exact.formula import InnerPaths
from jld_explore.drivers.exact.proof_check import Refutation, refutation
from jld_explore.drivers.exact.proof_state import Conflict
from jld_explore.space import feasible, to_string
from jld_explore.space.labelling import blocks_of
from jld_explore.space.search_space import SearchSpace
from jld_explore.verification import Checker
from jld_explore.verification.certificate import BlockMechanism, Claim, Lemma, Mechanism, Reason, Rule, write
from jld_explore.verification.verify import Balances, Labellings

# Relative amount by which the certified bound exceeds the bound of the search. It is a fifth of `tolerances.PROVEN`. It
# covers the accuracy of the solver that computes mechanisms again, and their rounding.
_SLACK: Final = 2e-7
_DIGITS: Final = 44  # binary digits of the velocities of a certificate, below the largest velocity

# Shares of a motion that opens all faces, relative, added to a mechanism in turn. Small shares suffice to keep a
# mechanism admissible after rounding. Large ones are for solvers that stopped far from the bound.
_OPENING_SHARES: Final = (0.0, *(10.0**-k for k in range(13, 2, -1)))
_BLOCKS_OPEN: Final = (1e-11, 1e-9)  # the same for block mechanisms, which are admissible before they are rounded
_REMEDY: Final = "a search whose proof has a certificate"


def check_certifiable(driver: Driver, model: SolveOptions, scene: Scene) -> None:
    """Raise InputError if the proof of a driver, model and scene cannot have a certificate."""
    search = driver.space.search
    for key, value in (("assemble", search.assemble), ("require", search.require)):
        if value is not None:
            raise ParameterError("certificate", f"it cannot express search.{key}", "a search without that")
    if driver.space.assembly.has_low_values:
        raise ParameterError(
            "certificate", "it proves λ at nominal values of materials, not at low ones", "`robust=False`"
        )
    if not isinstance(driver, Exact):
        raise ParameterError("certificate", f"the driver {driver.name} has no proof to write", '`driver="exact"`')
    assembly = driver.space.assembly
    Labellings(scene, assembly)  # raises InputError for a rule that the checker lacks
    if driver.aim != "best":
        raise ParameterError("certificate", "it cannot prove a whole front", '`aim="best"`')
    if not model.supports_bounds_over_labellings or model.friction != "associative":
        raise ParameterError("certificate", "it proves λ of associative friction only", '`objective="associative"`')
    for case in assembly.by_case:
        Balances(case)  # raises InputError for a face without a work balance
    if relaxation_of(assembly, [LimitAnalysis(case) for case in assembly.by_case]) is None:
        raise ParameterError("certificate", "this space is proven by enumeration, which writes none", _REMEDY)


def certify(
    driver: Exact, scene: Scene, path: Path, best: tuple[Bits, float] | None, bound: float | None = None
) -> None:
    bound = max((value for value in (bound, driver.bound) if value is not None), default=None)
    if bound is None:
        raise ParameterError("certificate", "the search ended without any bound", _REMEDY)
    Certifier(scene, driver.space, bound).write(path, driver.state.conflicts, best)


_RESIDUAL: Final = 1e-10  # residual asked of the solver, whose mechanisms are rounded to whole numbers
_ROUNDED_UP: Final = 1.0 + 1e-9  # factor on a ceiling: more than it is rounded


class Certifier:
    """Search for the mechanisms and rules that certify a bound on λ over a space."""

    def __init__(self, scene: Scene, space: SearchSpace, bound: float) -> None:
        # conflicts of the search are hints: mechanisms are computed again and rounded to whole numbers, the formula is
        # stated anew by rules of the checker, and only clauses that its refutation needs are written
        self._scene, self._space = scene, space
        assembly = space.assembly
        self.bound = bound + _SLACK * max(abs(bound), load_scale(assembly))
        self._claim = Claim(
            scene.model_dump(mode="json", exclude_defaults=True), self.bound, made_by=f"jld {__version__}"
        )
        self._analyses = [LimitAnalysis(case) for case in assembly.by_case]
        relaxation = relaxation_of(assembly, self._analyses)
        if relaxation is None:
            raise RuntimeError("a proof by conflicts needs a relaxation, and the assembly has none")
        self._relaxation, self._scale = relaxation, relaxation.unit
        self._checker = Checker(scene, assembly, self._claim)
        self._paths = InnerPaths(space)
        self._clauses: list[list[int]] = list(self._checker.labellings.beginning)
        self._reasons: list[Reason | None] = [None] * len(self._clauses)
        self._hints: dict[int, tuple[Bits, Bits, bool]] = {}
        self._solver = make_solver("clarabel", tolerance=_RESIDUAL)
        rules = self._checker.labellings
        candidates = np.flatnonzero(space.candidates).tolist()
        always_dry = [face for face in candidates if rules.too_large([face]) is not None]
        self._free = space.candidates.copy()
        self._free[always_dry] = False  # the formula has unit clauses that make these faces dry
        self._units = [_Units(analysis) for analysis in self._analyses]

    def write(self, path: Path, hints: Iterable[Conflict], best: tuple[Bits, float] | None) -> None:
        """Write the certificate; ArithmeticError if two satisfiability solvers disagree.

        best: labels (m,) of the strongest layout found, with its λ.
        """
        hints = [hint for hint in hints if not hint.from_cube and hint.bound * self._scale <= self.bound]
        root, ceilings = self._bound_of_all(hints)
        if root is not None:
            faces = [*(face + 1 for face in root.dry), *(-(face + 1) for face in root.inner)]
            self._add(faces, root)
        self._take_hints(hints if root is None else ())
        proof = self._refutation()
        needed = set(proof.needed)
        if any(isinstance(self._reasons[number], BlockMechanism) for number in needed):
            needed.update(ceilings)
        reasons, lemmas = self._numbered(proof, needed)
        claim = self._claim
        if best is not None:
            labels, load = best
            claim = Claim(claim.scene, claim.bound, to_string(labels), load, claim.made_by)
        write(path, claim, [*reasons, *lemmas])

    def _bound_of_all(self, hints: list[Conflict]) -> tuple[Mechanism | BlockMechanism | None, list[int]]:
        """Return the mechanism that bounds λ of all labellings, None without one, and clauses of ceilings added."""
        # a ceiling bounds λ of a load case for all labellings, above the bound; its clause, always true, only states it
        root: Mechanism | BlockMechanism | None = self._mechanism(*self._always_dry())
        ceilings: list[int] = []
        if root is None and any(hint.by_possible_blocks for hint in hints):
            ceilings = [self._add([1, -1], reason) for reason in self._ceilings()]
            if any(hint.by_possible_blocks and not len(hint.faces) for hint in hints):
                root = self._by_blocks(*self._always_dry())
        return root, ceilings

    def _refutation(self) -> Refutation:
        """Add clauses until they have no model, and return a refutation all of whose hints have mechanisms."""
        while True:
            self._exhaust()
            proof = refutation(self._clauses)
            if proof is None:
                raise ArithmeticError("two satisfiability solvers disagree")
            hints_needed = [number for number in proof.needed if number in self._hints]
            certified = [self._certify_hint(number) for number in hints_needed]
            if all(certified):
                return proof

    def _numbered(self, proof: Refutation, needed: set[int]) -> tuple[list[Reason], list[Lemma]]:
        """Return reasons of needed clauses and lemmas of a refutation, with the numbers of lines of a certificate."""
        beginning = len(self._checker.labellings.beginning)
        stated = sorted(number for number in needed if number >= beginning)
        # lines are numbered from 1: clauses that the checker states itself, those that are kept, lemmas
        line_of = {number: number + 1 for number in range(beginning)}
        line_of |= {number: beginning + 1 + k for k, number in enumerate(stated)}
        line_of |= {len(self._clauses) + k: beginning + 1 + len(stated) + k for k in range(len(proof.lemmas))}
        reasons = [reason for number in stated if (reason := self._reasons[number]) is not None]
        return reasons, [Lemma(literals, tuple(line_of[k] for k in by)) for literals, by in proof.lemmas]

    # --- what is ruled out ------------------------------------------------------------------------------

    def _add(self, clause: Sequence[int], reason: Reason | None) -> int:
        self._clauses.append(list(clause))
        self._reasons.append(reason)
        return len(self._clauses) - 1

    def _take_hints(self, hints: Iterable[Conflict]) -> None:
        """Add the clauses of conflicts and their images under symmetry, without reasons yet."""
        group = np.unique(np.argsort(self._space.group, axis=1), axis=0)
        for hint in hints:
            if not len(hint.faces):
                continue
            for image in group:
                decided, labels = self._always_dry()
                decided[image[hint.faces]], labels[image[hint.faces]] = True, hint.labels
                clause = [face + 1 if labels[face] else -(face + 1) for face in np.flatnonzero(decided).tolist()]
                number = self._add(clause, None)
                self._hints[number] = decided, labels, hint.by_possible_blocks

    def _always_dry(self) -> tuple[Bits, Bits]:
        """Return the faces (m,) that every labelling has dry, as decided faces and as labels."""
        decided = self._space.candidates & ~self._free
        return decided, decided.copy()

    def _certify_hint(self, number: int) -> bool:
        """Compute the mechanism of a hint, by its position; without one drop it and return False."""
        decided, labels, by_blocks = self._hints.pop(number)
        reason = (self._by_blocks(decided, labels) if by_blocks else None) or self._mechanism(decided, labels)
        if reason is None:
            self._clauses[number] = [1, -1]  # a tautology replaces the dropped clause
        self._reasons[number] = reason
        return reason is not None

    def _exhaust(self) -> None:
        """Add clauses that rule out labellings until the formula has no model left."""
        with Solver("cadical195", bootstrap_with=self._clauses) as solver:
            faces = len(self._space.fixed)
            while solver.solve():
                inner = {v for v in solver.get_model() if 0 < v <= faces}
                labels = np.array([face + 1 not in inner for face in range(faces)])
                rules = list(self._broken(labels))
                if rules:
                    for rule in rules:
                        clause = self._checker.clause(rule)
                        if clause is None or any((literal < 0) == labels[abs(literal) - 1] for literal in clause):
                            raise ArithmeticError(f"the check does not know how to break the rule {rule}")
                        self._add(clause, rule)
                        solver.add_clause(clause)
                    continue
                reason = self._refuted(labels)
                clause = [*(face + 1 for face in reason.dry), *(-(face + 1) for face in reason.inner)]
                self._add(clause, reason)
                solver.add_clause(clause)

    def _refuted(self, labels: Bits) -> Mechanism:
        """Return a mechanism that proves the bound for a labelling (m,), and for others with it."""
        conflict = conflict_of(self._relaxation, labels, self._free, self.bound / self._scale)
        if conflict is not None:
            decided, _ = self._always_dry()
            decided[conflict.faces] = True
            reason = self._mechanism(decided, labels)
            if reason is not None:
                return reason
        reason = self._mechanism(self._space.candidates, labels) or self._own_mechanism(labels)
        if reason is None:
            # limits on shapes and on most counts have no clauses: the proof speaks of layouts beyond them as well
            beyond = (
                "" if feasible(self._space, labels[None])[0] else ", which a limit that it cannot express excludes,"
            )
            problem = f"of the layout {to_string(labels)}{beyond} no mechanism keeps λ below {self.bound:.9g}"
            raise ParameterError("certificate", problem, "a search without that limit" if beyond else _REMEDY)
        return reason

    # --- mechanisms -------------------------------------------------------------------------------------

    def _mechanism(self, decided: Bits, labels: Bits) -> Mechanism | None:
        """Return a mechanism in whole numbers that proves the bound for labels (m,) where decided, or None."""
        labels = np.where(self._space.candidates, labels, self._space.fixed)
        undecided = self._space.candidates & ~decided
        for case, relaxation in enumerate(self._relaxation.by_case):
            raw = self._solver.solve(relaxation.program(labels, undecided))
            velocity = raw.dual[: relaxation.template.matrix.shape[0]]
            reason = self._rounded(case, velocity, self._space.candidates & decided, labels)
            if reason is not None:
                return reason
        return None

    def _ceilings(self) -> Iterator[Mechanism]:
        """Yield for each load case a mechanism that bounds λ of all labellings, if not by the bound."""
        labels, candidates = self._space.fixed, self._space.candidates
        for case, relaxation in enumerate(self._relaxation.by_case):
            raw = self._solver.solve(relaxation.program(labels, candidates))
            velocity = raw.dual[: relaxation.template.matrix.shape[0]]
            reason = self._rounded(case, velocity, ~candidates & candidates, labels, self._checker.lowers_ceiling)
            if reason is not None:
                yield reason

    @cached_property
    def _block_programs(self) -> tuple[list[BlockRelaxation], PossibleBlocks, BlockTables]:
        """Block relaxations of the load cases over the blocks that the checker lists, with tables of these."""
        listed = self._checker.labellings.blocks
        blocks = PossibleBlocks(tuple(block.members for block in listed), tuple(block.inside for block in listed))
        programs = [BlockRelaxation(analysis, blocks.members, blocks.inside) for analysis in self._analyses]
        return programs, blocks, BlockTables(self._space, blocks)

    def _by_blocks(self, decided: Bits, labels: Bits) -> BlockMechanism | None:
        """Return mechanisms of blocks in whole numbers that prove the bound for labels (m,) where decided, or None."""
        if not all(map(applies_to, self._analyses)):
            return None
        programs, blocks, tables = self._block_programs
        faces = np.flatnonzero(decided & self._space.candidates)
        allowed = tables.agreeing(faces, labels[faces])
        for case, program in enumerate(programs):
            ceiling, unit = self._checker.ceilings[case], self._analyses[case].template.scaling.load
            if ceiling is None:
                continue
            threshold = self.bound * float(self._space.assembly.required[case]) / unit
            most = float(ceiling) / unit * _ROUNDED_UP
            for accurately in (False, True):  # by the batch solver, then more accurately
                program_data = allowed, threshold, most
                choice = program.choose(*program_data) if accurately else program.bound_all([program_data])[0]
                for mechanism in choice.mechanisms:
                    reason = self._rounded_blocks(case, program, mechanism, allowed, (decided, labels), blocks)
                    if reason is not None:
                        return reason
        return None

    def _own_mechanism(self, labels: Bits) -> Mechanism | None:
        """Return a mechanism in whole numbers by limit analysis of a labelling (m,), or None."""
        for case, analysis in enumerate(self._analyses):
            mechanism = analysis.solve(labels).mechanism
            if mechanism is not None:
                velocity = mechanism[analysis.template.assembly.elements.free] * self._units[case].row
                reason = self._rounded(case, velocity.ravel(), self._space.candidates, labels)
                if reason is not None:
                    return reason
        return None

    def _rounded(
        self,
        case: int,
        velocity: Floats,
        decided: Bits,
        labels: Bits,
        accepts: Callable[[Mechanism], bool] | None = None,
    ) -> Mechanism | None:
        """Round scaled velocities (q·free,) to a mechanism that the checker accepts, or None."""
        size = float(abs(velocity).max(initial=0.0))
        if not 0.0 < size < 1e30:
            return None
        units = self._units[case]
        dry = tuple(np.flatnonzero(decided & labels).tolist())
        inner = tuple(np.flatnonzero(decided & ~labels).tolist())
        for share in _OPENING_SHARES:
            opened = units.opened(velocity / size, share)
            if opened is None:
                break
            digits, moves = units.whole(opened)
            reason = Mechanism(dry, inner, case, digits, moves)
            if self._checker.clause(reason) is not None if accepts is None else accepts(reason):
                return reason
        return None

    def _rounded_blocks(
        self,
        case: int,
        program: BlockRelaxation,
        mechanism: ScaledBlockMechanism,
        allowed: Bools,
        partial_labelling: tuple[Bits, Bits],
        blocks: PossibleBlocks,
    ) -> BlockMechanism | None:
        """Round the mechanism of a block relaxation to whole numbers that the checker accepts, or None."""
        decided, labels = partial_labelling[0] & self._space.candidates, partial_labelling[1]
        assembly, scaling, parts = program.template.assembly, program.template.scaling, program.parts
        free = assembly.elements.free.tolist()
        multipliers = mechanism.multipliers
        # number of each face among the faces with velocities of their own, −1 for others
        wall_of_face = np.full(len(decided), -1)
        wall_of_face[parts.side_face] = parts.side_shared
        shared = np.flatnonzero(wall_of_face >= 0)
        for share in _BLOCKS_OPEN:
            opened = program.opened(multipliers, allowed, share)
            if opened is None:
                return None
            scaled_velocity, scaled_wall = opened
            velocity = scaled_velocity / scaling.row[parts.part_element]
            wall = scaled_wall[wall_of_face[shared]] / scaling.face[shared]
            size = float(max(abs(velocity).max(), abs(wall).max(initial=0.0)))
            bits_of_size = int(np.floor(np.log2(size)) - np.ceil(max(0.0, np.log2(assembly.size))))
            digits = max(_DIGITS - bits_of_size, 0)
            price = np.column_stack([multipliers.price, multipliers.portion / scaling.load])
            begin = np.searchsorted(parts.part_block, np.arange(len(blocks) + 1))  # first part of each block
            moves = {}
            for p, members in enumerate(blocks.members):
                if allowed[p]:
                    rows = (_whole(row, digits) for row in velocity[begin[p] : begin[p + 1]])
                    moves[members] = tuple(itertools.chain(*rows))
            reason = BlockMechanism(
                tuple(np.flatnonzero(decided & labels).tolist()),
                tuple(np.flatnonzero(decided & ~labels).tolist()),
                case,
                digits,
                {face: _whole(row, digits) for face, row in zip(shared.tolist(), wall, strict=True)},
                {free[e]: _whole(row, digits) for e, row in enumerate(price)},
                moves,
            )
            if self._checker.clause(reason) is not None:
                return reason
        return None

    # --- rules of a segmentation ------------------------------------------------------------------------

    def _broken(self, labels: Bits) -> Iterable[Rule]:
        """Yield the rules of a segmentation that a labelling (m,) breaks."""
        space, graph = self._space, self._space.graph
        blocks, limits = blocks_of(graph, labels), space.limits
        if space.search.segmentation:
            for face in np.flatnonzero(labels & (blocks[graph.a] == blocks[graph.b])).tolist():
                path = self._paths.path(labels, int(graph.a[face]), int(graph.b[face]))
                if path:
                    yield Rule("slit", (face, *path))
        free = set(space.assembly.elements.free.tolist())
        sized = limits.sized
        for name in np.unique(blocks[space.assembly.elements.free]).tolist():
            block = np.flatnonzero(blocks == name).tolist()
            members = frozenset(block) & free
            if limits.too_large(sized.one(members)):
                yield Rule("large", tuple(self._paths.tree(labels, min(members))))
            elif limits.too_small(sized.one(members)):
                yield Rule("small", tuple(block))


class _Units:
    """Conversion of scaled velocities of one load case to whole numbers of scene units."""

    def __init__(self, analysis: LimitAnalysis) -> None:
        template = analysis.template
        self._free = template.assembly.elements.free
        self.row = template.scaling.row
        self._size = template.assembly.size
        opening = analysis.repair.opening()
        self._opening = None if opening is None else opening.velocity / float(abs(opening.velocity).max())

    def opened(self, velocity: Floats, share: float) -> Floats | None:
        """Add `share` of a motion that opens all faces to a velocity; None without such a motion."""
        if share == 0.0:
            return velocity
        return None if self._opening is None else velocity + share * self._opening

    def whole(self, velocity: Floats) -> tuple[int, dict[int, tuple[int, ...]]]:
        """Return binary digits, and by element the velocities in scene units times 2**digits."""
        table = velocity.reshape(self.row.shape) / self.row
        # A rotation moves distant points most, so the size of the structure lowers the exponent.
        exponent = np.floor(np.log2(float(abs(table).max()))) - np.ceil(max(0.0, np.log2(self._size)))
        digits = max(_DIGITS - int(exponent), 0)
        moves = {}
        for element, values in zip(self._free.tolist(), table.tolist(), strict=True):
            numbers = _whole(values, digits)
            if any(numbers):
                moves[element] = numbers
        return digits, moves


def _whole(values: Iterable[float], digits: int) -> tuple[int, ...]:
    return tuple(round(Fraction(float(value)) * (1 << digits)) for value in values)
