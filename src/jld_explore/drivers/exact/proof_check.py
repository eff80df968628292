"""Derive the claims of a finished proof again by other means than the search (docs/guide/trust.md)."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from pysat.solvers import Solver

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats
from jld_core.limit.bounds import exceeds
from jld_core.limit.options import Status
from jld_explore.drivers.exact.block_bounds import BlockConflictCheck
from jld_explore.drivers.exact.context import CheckedProof, PossibleBlocks
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.proof_state import Conflict, Evidence, Mechanism, ProofState
from jld_explore.evaluation.protocol import Evaluation
from jld_explore.space import Count, count_named, values_of
from jld_explore.space.limits import Range
from jld_explore.space.search_space import SearchSpace

if TYPE_CHECKING:
    import pandas as pd


_SOLVER: Final = "glucose42"  # satisfiability solver of the check, another one than that of the search

# Relative difference allowed when the bound of a mechanism is evaluated again. It covers rounding and is a thousandth
# of `tolerances.PROVEN`.
_BOUND_TOLERANCE: Final = 1e-9

# Share of the time of the proof allowed for refuting conflicts again. Only conflicts whose mechanism is no longer in
# memory are refuted again.
_REFUTATION_SHARE: Final = 0.03
_REFUTATION_SECONDS: Final = 0.2  # time, s, that is allowed for refuting such conflicts again in any case
_MECHANISMS_PER_CALL: Final = 256  # number of mechanisms evaluated in one call

# Relative rounding error of a load factor that was scaled and scaled back
_SCALING_ERROR: Final = 4.0 * float(np.finfo(float).eps)


@dataclass(frozen=True)
class Claim:
    """Claim that no labelling with a count exceeds a threshold, evaluated ones excepted."""

    count: int | Range | None  # value of the count of the front, bounds on it, or None for all labellings
    threshold: float  # scaled λ


@dataclass(frozen=True)
class ProofCheck:
    problem: str  # problem in one line, "" if the proof passed
    seconds: float  # time of the check, s
    conflicts: int = 0  # number of conflicts that the claims rest on
    weighed: int = 0  # number of those whose mechanism was evaluated, or that were refuted, again
    # conflicts whose mechanism keeps λ at more than was recorded, with the bound that it does prove
    corrected: tuple[Conflict, ...] = ()
    # claims that the corrected conflicts prove in place of those checked; empty where nothing is corrected, or where
    # they do not prove these either
    holds: tuple[Claim, ...] = ()

    @property
    def passed(self) -> bool:
        return not self.problem

    def to_dict(self) -> dict[str, Any]:
        facts: dict[str, Any] = {"passed": self.passed, "seconds": self.seconds}
        facts |= {"conflicts": self.conflicts, "weighed": self.weighed}
        return facts if self.passed else {**facts, "problem": self.problem}


def check_proof(
    context: CheckedProof,
    state: ProofState,
    claims: Sequence[Claim],
    evaluated: tuple[Bits, Floats],
    problem: str,
    seconds: float,
) -> ProofCheck:
    """Check the claims of a finished proof by deriving them again from its conflicts.

    evaluated: (k, m) the strongest labellings, and scaled λ (k,) that each is proven to carry. problem: found before.
    """
    # Mechanisms over faces that are in memory are all evaluated again. Other conflicts are refuted again in random
    # order, for a limited time. The result names the first problem found; nothing is raised for a proof that fails.
    start = time.perf_counter()
    if problem:
        return ProofCheck(problem, time.perf_counter() - start)
    highest = max((_with_scaling_error(claim.threshold) for claim in claims), default=-math.inf)
    used = [conflict for conflict in state.conflicts if not conflict.from_cube and conflict.bound <= highest]
    conflict_check, block_check = _ConflictCheck(context), BlockConflictCheck(context)
    end = start + max(_REFUTATION_SECONDS, _REFUTATION_SHARE * seconds)
    conflict_check.weigh(used)
    conflict_check.refute_again(used, end)
    better = conflict_check.corrected  # one that no claim rests on is no problem
    corrected_conflicts = [better.get(conflict.key, conflict) for conflict in used]
    raised = [_raise_claim(claim, used, corrected_conflicts) for claim in claims] if better else list(claims)
    problem = (
        _find_contradiction(corrected_conflicts, context.space, *evaluated)
        or block_check.refute_again(corrected_conflicts, end)
        or _find_open_labelling(context.space, context.blocks, corrected_conflicts, state, raised)
    )
    holds = () if problem or not better else tuple(raised)
    higher = any(raised_claim.threshold > claim.threshold for raised_claim, claim in zip(raised, claims, strict=True))
    problem = problem or (conflict_check.problem if higher else "")
    weighed = conflict_check.done + block_check.done
    return ProofCheck(problem, time.perf_counter() - start, len(used), weighed, tuple(better.values()), holds)


def _raise_claim(claim: Claim, used: Sequence[Conflict], corrected: Sequence[Conflict]) -> Claim:
    """Return a claim raised to the largest bound of the conflicts `used` for it, as corrected."""
    highest = _with_scaling_error(claim.threshold)
    bounds = [new.bound for old, new in zip(used, corrected, strict=True) if old.bound <= highest < new.bound]
    return replace(claim, threshold=max([claim.threshold, *bounds]))


class _ConflictCheck:
    """Repeated evaluation of conflicts; wrong ones are corrected to the bound that holds."""

    def __init__(self, context: CheckedProof) -> None:
        self._relaxation, self._free, self._labels = context.relaxation, context.free, context.labels
        self.done, self.problem = 0, ""
        self.corrected: dict[tuple[bytes, bytes], Conflict] = {}

    def weigh(self, conflicts: Sequence[Conflict]) -> None:
        """Evaluate mechanisms again, and correct bounds that they do not prove."""
        cases = sorted({conflict.mechanism.case for conflict in conflicts if conflict.mechanism is not None})
        for case in cases:
            of_case = [
                conflict for conflict in conflicts if conflict.mechanism is not None and conflict.mechanism.case == case
            ]
            for part in _parts(of_case):
                velocities = np.array([checked.mechanism.velocity for checked in part if checked.mechanism is not None])
                bounds = self._relaxation.evaluate_mechanisms(case, velocities, *self._partial(part))
                claimed = np.array([checked.bound for checked in part])
                tolerance = _BOUND_TOLERANCE * np.maximum(1.0, abs(np.where(np.isfinite(claimed), claimed, 0.0)))
                for k in np.flatnonzero(~(bounds <= claimed + tolerance)).tolist():
                    problem = f"a mechanism that was to keep λ at {claimed[k]:.9g} keeps it at {bounds[k]:.9g} (scaled)"
                    self._correct(part[k], float(bounds[k]), problem)
                self.done += len(part)

    def _correct(self, conflict: Conflict, bound: float, problem: str) -> None:
        """Record that a conflict keeps λ at `bound`, or at less if a new mechanism does."""
        self.problem = self.problem or problem
        labels, undecided = self._partial([conflict])
        mechanism = self._relaxation.least_bound(labels[0], undecided[0])
        if mechanism is not None:
            velocities = mechanism.velocity[None]
            (proven,) = self._relaxation.evaluate_mechanisms(mechanism.case, velocities, labels, undecided)
            if proven < bound:
                bound = max(float(proven), conflict.bound)
                conflict = replace(conflict, mechanism=Mechanism(mechanism.case, mechanism.velocity))
        self.corrected[conflict.key] = replace(conflict, bound=bound)

    def refute_again(self, conflicts: Sequence[Conflict], end: float) -> None:
        """Refute conflicts without a mechanism again, in random order, until a time."""
        lacking = [
            conflict for conflict in conflicts if conflict.mechanism is None and conflict.evidence is Evidence.MECHANISM
        ]
        order = np.random.default_rng(len(lacking)).permutation(len(lacking))
        for part in _parts([lacking[k] for k in order.tolist()]):
            if time.perf_counter() >= end:
                break
            claimed = np.array([conflict.bound for conflict in part])
            # −inf claims that no λ ≥ 0 is left, so that such a conflict is refuted at 0
            claimed_load = np.where(np.isfinite(claimed), claimed, 0.0)
            thresholds = claimed_load + tolerances.PROVEN * np.maximum(1.0, abs(claimed_load))
            refutations = self._relaxation.refute_all(*self._partial(part), thresholds)
            for k, refutation in enumerate(refutations):
                if refutation is None:
                    problem = f"a conflict on record that was to keep λ at {claimed[k]:.9g} is not refuted (scaled)"
                    self._correct(part[k], math.inf, problem)
            self.done += len(part)

    def _partial(self, conflicts: Sequence[Conflict]) -> tuple[Bits, Bools]:
        """Return labels (k, m), True = dry, and undecided faces (k, m) of k conflicts."""
        labels = np.tile(self._labels, (len(conflicts), 1))
        undecided = np.tile(self._free, (len(conflicts), 1))
        for k, conflict in enumerate(conflicts):
            labels[k, conflict.faces] = conflict.labels
            undecided[k, conflict.faces] = False
        return labels, undecided


def _parts(conflicts: Sequence[Conflict]) -> Iterator[Sequence[Conflict]]:
    """Yield conflicts in groups of at most `_MECHANISMS_PER_CALL`."""
    for first in range(0, len(conflicts), _MECHANISMS_PER_CALL):
        yield conflicts[first : first + _MECHANISMS_PER_CALL]


def _find_contradiction(conflicts: Sequence[Conflict], space: SearchSpace, labellings: Bits, loads: Floats) -> str:
    """Return a problem if an evaluated labelling carries more than a conflict allows, else ""."""
    if not len(conflicts) or not len(labellings):
        return ""
    dry, inner = np.zeros((2, len(conflicts), len(space.fixed)), dtype=np.float32)
    for k, conflict in enumerate(conflicts):
        dry[k, conflict.faces[conflict.labels]] = 1.0
        inner[k, conflict.faces[~conflict.labels]] = 1.0
    bounds = np.array([conflict.bound for conflict in conflicts])
    for labels, load in zip(labellings, loads.tolist(), strict=True):
        weaker = np.flatnonzero(load > bounds + tolerances.PROVEN * np.maximum(1.0, abs(load)))
        if not weaker.size:
            continue
        images = labels[space.group].astype(np.float32)
        # number of faces on which an image differs from a conflict, by matrix products
        differing = dry[weaker] @ (1.0 - images.T) + inner[weaker] @ images.T
        matching = np.flatnonzero((differing == 0.0).any(axis=1))
        if matching.size:
            bound = bounds[weaker[matching[0]]]
            return f"a layout carries {load:.9g}, and a conflict allows it {bound:.9g} (scaled)"
    return ""


def _find_open_labelling(
    space: SearchSpace,
    blocks: PossibleBlocks | None,
    conflicts: Sequence[Conflict],
    state: ProofState,
    claims: Sequence[Claim],
) -> str:
    """Return a problem if a formula stated anew leaves a labelling above a claim, else ""."""
    # A labelling that was handed over and has no evaluation must be refuted by a conflict like any other.
    formula = Formula(space, blocks, _SOLVER)
    formula.learn(conflicts, filter(state.is_evaluated, state.handed_over))
    for claim in claims:
        formula.aim(_with_scaling_error(claim.threshold), claim.count)
        if formula.next() is not None:
            waiting = len(state.without_evaluation)
            return (
                "a layout is left that no conflict refutes and that was not evaluated"
                f" ({waiting} were handed over and wait for their evaluation)"
            )
    if formula.undecided:
        number = f"for {formula.undecided} layouts that no conflict refutes"
        return f"{number} the search for an order whose stages stand stopped at its limit"
    return ""


def _with_scaling_error(threshold: float) -> float:
    """Return a scaled λ raised by the rounding of scaling."""
    return threshold + _SCALING_ERROR * abs(threshold) if math.isfinite(threshold) else threshold


_LOGGING = "cadical195"  # satisfiability solver that logs its proof


@dataclass(frozen=True)
class Refutation:
    needed: tuple[int, ...]  # positions of the clauses that are used, ascending
    # literals of each lemma, and its reasons: positions of clauses, or number of clauses + position of a lemma
    lemmas: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]


def refutation(clauses: Sequence[Sequence[int]]) -> Refutation | None:
    """Return a refutation of clauses, None if they have a model; ArithmeticError if it does not hold."""
    empty = next((k for k, clause in enumerate(clauses) if not clause), None)
    if empty is not None:
        return Refutation((empty,), (((), (empty,)),))
    with Solver(_LOGGING, with_proof=True) as solver:
        for clause in clauses:
            solver.add_clause(list(clause))
        if solver.solve():
            return None
        lines = solver.get_proof()
    # deletions only speed up a checker; additional clauses do not invalidate the proof
    learnt = [[int(word) for word in line.split()[:-1]] for line in lines if not line.startswith("d")]
    propagation = _Propagation()
    for clause in clauses:
        propagation.add(clause)
    reasons: list[tuple[int, ...]] = []
    lemmas: list[tuple[int, ...]] = []
    for literals in [*learnt, []]:
        by = propagation.follows(literals)
        if by is None:
            raise ArithmeticError("a solver's proof does not hold")
        reasons.append(by)
        lemmas.append(tuple(dict.fromkeys(literals)))
        propagation.add(literals)
        if not literals:
            break
    return _trim(len(clauses), lemmas, reasons)


def _trim(count: int, lemmas: list[tuple[int, ...]], reasons: list[tuple[int, ...]]) -> Refutation:
    """Return the refutation with only the clauses and lemmas that the last lemma needs."""
    used = {count + len(lemmas) - 1}
    for lemma in range(len(lemmas) - 1, -1, -1):
        if count + lemma in used:
            used.update(reasons[lemma])
    needed = [lemma for lemma in range(len(lemmas)) if count + lemma in used]
    new_number = {count + lemma: count + k for k, lemma in enumerate(needed)}
    return Refutation(
        tuple(sorted(number for number in used if number < count)),
        tuple((lemmas[lemma], tuple(new_number.get(number, number) for number in reasons[lemma])) for lemma in needed),
    )


class _Propagation:
    """Unit propagation with two watched literals; unit clauses stay assigned."""

    def __init__(self) -> None:
        self._clauses: list[list[int]] = []
        self._watches: dict[int, list[int]] = {}
        self._reason: dict[int, int] = {}  # true literals with the clause that implies each, −1 for assumed ones
        self._trail: list[int] = []
        self._head = 0
        self._conflict: int | None = None

    def add(self, literals: Sequence[int]) -> None:
        """Add a clause, and propagate what it forces."""
        clause = list(dict.fromkeys(literals))
        name = len(self._clauses)
        self._clauses.append(clause)
        # literals that are not false come first, because watched literals must not be false
        clause.sort(key=lambda literal: -literal in self._reason)
        for literal in clause[:2]:
            self._watches.setdefault(literal, []).append(name)
        if self._conflict is None and (len(clause) < 2 or -clause[1] in self._reason):
            if not clause or -clause[0] in self._reason:
                self._conflict = name
            elif clause[0] not in self._reason:
                self._assign(clause[0], name)
                self._conflict = self._propagate()

    def follows(self, literals: Sequence[int]) -> tuple[int, ...] | None:
        """Return the clauses by whose propagation a lemma follows, in order; None if it does not."""
        if self._conflict is not None:
            return self._why(self._conflict)
        mark = len(self._trail)
        conflict: int | None = None
        for literal in literals:
            if literal in self._reason:
                # true by a clause, which is false under the lemma's negation; assumed: the lemma holds both signs
                conflict = self._reason[literal]
                if conflict < 0:
                    conflict = None
                    continue
                break
            if -literal not in self._reason:
                self._assign(-literal, -1)
        if conflict is None:
            conflict = self._propagate()
        clauses = None if conflict is None else self._why(conflict)
        # take back what the lemma's negation has assigned
        for literal in self._trail[mark:]:
            del self._reason[literal]
        del self._trail[mark:]
        self._head = mark
        return clauses

    def _assign(self, literal: int, name: int) -> None:
        """Make a literal true, with the clause that implies it as reason (−1: assumed)."""
        self._reason[literal] = name
        self._trail.append(literal)

    def _propagate(self) -> int | None:
        """Propagate all assigned literals; return the clause that became false, or None."""
        reason, clauses, trail = self._reason, self._clauses, self._trail
        while self._head < len(trail):
            false = -trail[self._head]
            self._head += 1
            watchers = self._watches.get(false)
            if not watchers:
                continue
            still_watching: list[int] = []  # clauses that go on watching the false literal
            for index, number in enumerate(watchers):
                # the watched literals are the first two; the false one comes second
                clause = clauses[number]
                if clause[0] == false:
                    clause[0], clause[1] = clause[1], clause[0]
                first = clause[0]
                if first in reason:
                    still_watching.append(number)
                    continue
                for k in range(2, len(clause)):
                    if -clause[k] not in reason:
                        clause[1], clause[k] = clause[k], false
                        self._watches.setdefault(clause[1], []).append(number)
                        break
                else:
                    still_watching.append(number)
                    if -first in reason:
                        self._watches[false] = still_watching + watchers[index + 1 :]
                        return number
                    reason[first] = number
                    trail.append(first)
            self._watches[false] = still_watching
        return None

    def _why(self, conflict: int) -> tuple[int, ...]:
        """Return the clauses that imply a false clause, each after those it needs; it is last."""
        position = {literal: k for k, literal in enumerate(self._trail)}
        reached = {conflict}
        needed: list[tuple[int, int]] = []
        pending = [conflict]
        while pending:
            for literal in self._clauses[pending.pop()]:
                number = self._reason.get(-literal, -1)
                if number >= 0 and number not in reached:
                    reached.add(number)
                    needed.append((position[-literal], number))
                    pending.append(number)
        return (*(number for _, number in sorted(needed)), conflict)


class Incumbents:
    """Bounds of all evaluated labellings, and the best λ for each count; None for all labellings."""

    def __init__(self, space: SearchSpace, count: Count | None) -> None:
        self._space, self._count = space, count
        self._bounds: dict[bytes, tuple[float, float, int]] = {}
        self._best: dict[int | None, float] = {}

    def learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Record the bounds of evaluated labellings (k, m), with k evaluations in their order."""
        # Labellings that collapse have both bounds. A failed or uncertified one keeps its upper bound, inf without one.
        # All others have −inf for both, since no λ of theirs counts. With zero dilation the upper bound is at least the
        # associative λ.
        counts = [0] * len(labellings)
        if self._count is not None:
            counts = values_of(self._count, self._space.assembly, labellings, self._space.graph).tolist()
        for labels, evaluation, count in zip(labellings, evaluations, counts, strict=True):
            low = evaluation.low if evaluation.status is Status.COLLAPSE else -math.inf
            high = evaluation.high if evaluation.status is Status.COLLAPSE else -math.inf
            if evaluation.status in (Status.UNCERTIFIED, Status.FAILED):
                high = evaluation.high if math.isfinite(evaluation.high) else math.inf
            if math.isfinite(evaluation.zero_dilation):
                # other solutions without dilation may exist; the associative λ bounds all of them
                high = max(high, evaluation.associative * (1.0 + tolerances.PROVEN))
            self._bounds[np.packbits(labels).tobytes()] = (low, high, count)
            for key in (None, count):
                self._best[key] = max(low, self._best.get(key, -math.inf))

    def __bool__(self) -> bool:
        """Return whether any labelling was evaluated."""
        return bool(self._bounds)

    def __contains__(self, labels: Bits) -> bool:
        """Return whether a canonical labelling (m,) was evaluated."""
        return np.packbits(labels).tobytes() in self._bounds

    def strongest(self, count: int) -> tuple[Bits, Floats]:
        """Return the labellings (k, m) of largest proven λ, and that λ (k,), scene units, best first."""
        stands = [(low, key) for key, (low, _, _) in self._bounds.items() if math.isfinite(low)]
        stands.sort(key=lambda stand: (-stand[0], stand[1]))
        faces = len(self._space.fixed)
        packed = np.frombuffer(b"".join(key for _, key in stands[:count]), dtype=np.uint8)
        rows = np.unpackbits(packed.reshape(-1, (faces + 7) // 8), axis=1, count=faces).astype(bool)
        return rows, np.array([low for low, _ in stands[:count]])

    def best(self, target: int | None) -> float:
        """Return the largest proven λ, scene units, for a count or None for all; −inf without one."""
        return self._best.get(target, -math.inf)

    def high(self, labels: Bits, target: int | None) -> float:
        """Return the λ, scene units, that a labelling (m,) does not exceed; −inf if of another count."""
        _, high, count = self._bounds.get(np.packbits(labels).tobytes(), (-math.inf, math.inf, target))
        return high if target is None or count == target else -math.inf


@dataclass(frozen=True)
class Best:
    """Best λ found and proven bound of the labellings with one count, or of all."""

    count: int | None  # value of the count; None for all labellings
    load_factor: float  # largest λ found, scene units; NaN if there is none
    # proven upper bound on λ, scene units; −inf if no labelling stands or none exists, inf if nothing is known
    bound: float
    load_scale: float = 0.0  # λ below which differences do not matter, scene units

    @property
    def proven(self) -> bool:
        """True if no labelling is better by more than `tolerances.PROVEN`, relative."""
        if self.bound == -math.inf:
            return True
        if not (math.isfinite(self.bound) and math.isfinite(self.load_factor)):
            return False
        size = max(abs(self.bound), abs(self.load_factor), self.load_scale)
        return bool(self.bound - self.load_factor <= tolerances.PROVEN * size)


def claims_of(
    targets: Iterable[Best], incumbents: Incumbents, scale: float, load_scale: float
) -> tuple[list[Claim], str]:
    """Return the claims of a proof, and the first contradiction to a λ found ("" for none)."""
    claims, problem = [], ""
    for best in targets:
        # if no labelling stands none exceeds zero
        claims.append(Claim(best.count, (0.0 if best.bound == -math.inf else best.bound) / scale))
        low = incumbents.best(best.count)
        if not best.proven:
            problem = problem or f"the bound {best.bound:.9g} is not met"
        if math.isfinite(low) and exceeds(low, best.bound, load_scale):
            problem = problem or f"a layout carries {low:.9g}, above the bound {best.bound:.9g}"
    return claims, problem


def front(targets: Iterable[Best]) -> list[dict[str, Any]]:
    """Return the rows of the proven front: count, load_factor, bound and proven."""
    # Counts for which no labelling stands are left out.
    rows: list[dict[str, Any]] = []
    for best in targets:
        if best.count is None or (math.isnan(best.load_factor) and best.bound == -math.inf):
            continue
        load_factor = None if math.isnan(best.load_factor) else best.load_factor
        bound = best.bound if math.isfinite(best.bound) else None
        rows.append({"count": best.count, "load_factor": load_factor, "bound": bound, "proven": best.proven})
    return sorted(rows, key=lambda row: int(row["count"]))


def front_of_all(results: pd.DataFrame, count: str, complete: bool) -> list[dict[str, Any]]:
    """Return the rows of the front of an enumerated space: count, load_factor, bound, proven."""
    rows: list[dict[str, Any]] = []
    for value, group in results.groupby(count):
        stands = group["stands_at_zero"].fillna(True).astype(bool)
        ranked = group[(group["status"] == str(Status.COLLAPSE)) & stands]
        if not ranked.empty:
            sure = complete and not group["status"].isin([str(Status.UNCERTIFIED), str(Status.FAILED)]).any()
            best, bound = float(ranked["load_factor"].max()), float(ranked["bracket_hi"].max())
            low, others = float(ranked["bracket_lo"].max()), ranked["bracket_hi"].drop(ranked["bracket_lo"].idxmax())
            # proven only if no other layout may exceed the best lower bound
            sure = sure and not others.max() - low > tolerances.PROVEN * abs(bound)
            number = value if isinstance(value, float) else int(str(value))
            rows.append({"count": number, "load_factor": best, "bound": bound if sure else None, "proven": sure})
    return rows


def counts_of(space: SearchSpace, count: Count) -> list[int]:
    """Return all values that a count may take within the limits of a space, ascending."""
    if count.terms is None:
        raise ValueError(f"{count.name} is no sum of binary terms")
    greatest = count.terms(space.assembly).most(space.assembly)
    bounds = next((bounds for limited, bounds in space.limits.on_counts if limited is count), None)
    if bounds is None:
        return list(range(greatest + 1))
    return list(range(int(bounds.low or 0), (greatest if bounds.high is None else min(int(bounds.high), greatest)) + 1))


# Relative distance above the best λ known at which labellings are sought. It is half of `tolerances.PROVEN`, the
# relative difference that counts as proven.
_INCREASE: Final = 0.5 * tolerances.PROVEN


def front_count(space: SearchSpace) -> Count | None:
    axes = space.search.front
    count = count_named(axes.count)
    return None if axes.counts or count.terms is None else count


class Targets:
    """Targets of a proof: all labellings, and for a front those of each value of its count."""

    def __init__(self, space: SearchSpace, count: Count | None, incumbents: Incumbents, load_scale: float) -> None:
        self._space, self._count, self._incumbents, self._load_scale = space, count, incumbents, load_scale
        self.found: dict[int | None, Best] = {}  # by count; None: all labellings
        self.left: list[int | None] = []  # targets that are not settled
        self._listed = False
        self.restart()

    def restart(self) -> None:
        self.found = {None: self._target_with_bound(None, math.inf)}
        self.left = [None]
        self._listed = False

    def _target_with_bound(self, target: int | None, bound: float) -> Best:
        """Return a target with its best λ known and a given bound, scene units."""
        low = self._incumbents.best(target)
        return Best(target, low if math.isfinite(low) else math.nan, bound, self._load_scale)

    def learn(self) -> None:
        """Raise the best λ of each target to the best one among the incumbents."""
        for target, best in self.found.items():
            low = self._incumbents.best(target)
            if math.isfinite(low) and not best.load_factor >= low:
                self.found[target] = replace(best, load_factor=low)

    def least(self, target: int | None) -> float:
        """Return the λ, scene units, that a labelling must exceed to count as better; 0 without a best."""
        low = self._incumbents.best(target)
        return low + _INCREASE * max(abs(low), self._load_scale) if math.isfinite(low) else 0.0

    def lower_bound(self, target: int | None, bound: float, handed_over: Iterable[Bits]) -> None:
        """Lower the bound of a target, but not below those of labellings (m,) handed over."""
        for labels in handed_over:
            bound = max(bound, self._incumbents.high(labels, target))
        best = self.found[target]
        if bound < best.bound:
            self.found[target] = replace(best, bound=bound)

    def raise_to(self, claims: Iterable[Claim], scale: float) -> None:
        """Raise bounds to claims that hold after a correction, and take up targets no longer proven."""
        for claim in claims:
            assert not isinstance(claim.count, Range)  # of the driver that minimises a count
            best = self.found[claim.count]
            if claim.threshold * scale > max(best.bound, 0.0):
                self.found[claim.count] = best = replace(best, bound=claim.threshold * scale)
            if not best.proven and claim.count not in self.left:
                self.left.append(claim.count)

    def settle(self, target: int | None) -> None:
        """Remove a proven target from `left`; for a front the first one adds one target per count."""
        # A target without a λ whose bound is at most 0 gets the bound −inf: none of its labellings stands.
        best = self.found[target]
        if math.isnan(best.load_factor) and best.bound <= 0.0:
            self.found[target] = best = replace(best, bound=-math.inf)
        self.left.remove(target)
        if self._count is None or self._listed:
            return
        self._listed = True
        for count in counts_of(self._space, self._count):
            self.found[count] = self._target_with_bound(count, best.bound)
            self.left.append(count)
