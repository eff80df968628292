"""Check a certificate: its scene, every reason, and that no labelling is left."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from jld_core.assembly import Assembly
from jld_core.build import build_assembly
from jld_core.errors import InputError
from jld_core.scene import Scene, parse_scene
from jld_explore.verification.balance import Balances
from jld_explore.verification.certificate import Claim, Lemma, Mechanism, Reason, Rule, read
from jld_explore.verification.labellings import Labellings


def follows(lemma: Sequence[int], by: Sequence[int], clauses: Mapping[int, Sequence[int]]) -> bool:
    """Return whether a lemma follows by reverse unit propagation from given clauses in order."""
    # With the lemma false, each of these clauses in turn must have one literal left, and the last one none.
    false = set(lemma)
    if any(-literal in false for literal in lemma):
        return True
    for name in by:
        clause = clauses.get(name)
        if clause is None:
            return False
        left = [literal for literal in clause if literal not in false]
        if not left:
            return True
        if len(set(left)) > 1:
            return False
        false.add(-left[0])
    return False


@dataclass(frozen=True)
class Verified:
    """Result of a successful check: no labelling of the scene carries a λ above `claim.bound`."""

    claim: Claim  # statement of the certificate
    scene: Scene  # scene that the certificate holds
    # mechanisms, rules, lemmas: number of reasons of each kind
    mechanisms: int
    rules: int
    lemmas: int
    size: int  # size of the file, bytes
    seconds: float  # time of the check, s


def verify(path: Path, scene: Scene | None = None) -> Verified:
    """Check a certificate, without the program that searched, solved or wrote it.

    Parameters
    ----------
    path : Path
        Path.
    scene : Scene, optional
        Scene that the certificate must be of; by default the scene it holds.

    Returns
    -------
    Verified

    Raises
    ------
    InputError
        For the first reason that does not hold, a damaged file, or another scene.
    """
    start = time.perf_counter()
    claim, reasons = read(path)
    held = parse_scene(claim.scene, str(path))
    if scene is not None and scene.fingerprint != held.fingerprint:
        problem = f"it is of another scene ({held.name!r})"
        raise InputError(str(path), problem, f"a certificate of {scene.name!r} as it stands")
    try:
        Checker(held, build_assembly(held), claim).check(reasons)
    except InputError as error:
        raise error.within(str(path)) from None
    kinds = Counter(type(reason) for reason in reasons)
    seconds = time.perf_counter() - start
    return Verified(claim, held, kinds[Mechanism], kinds[Rule], kinds[Lemma], path.stat().st_size, seconds)


class Checker:
    """Checker of the reasons of one claim, in order."""

    def __init__(self, scene: Scene, assembly: Assembly, claim: Claim) -> None:
        self.labellings = Labellings(scene, assembly)
        cases = assembly.by_case
        self._balances = [Balances(case) for case in cases]
        self._bounds = [Fraction(claim.bound) * Fraction(required) for required in assembly.required.tolist()]
        self._faces = len(assembly.interfaces)
        self.clauses: dict[int, list[int]] = dict(enumerate(self.labellings.beginning, 1))
        self._refuted = any(not clause for clause in self.labellings.beginning)
        self._check_labelling(claim.labelling)

    def _check_labelling(self, labelling: str | None) -> None:
        """Raise InputError if a labelling has the wrong length or contradicts a fixed label."""
        if labelling is None:
            return
        if len(labelling) != self._faces:
            problem = f"its labelling has {len(labelling)} letters"
            raise InputError("labelling", problem, f"{self._faces}, one for each face")
        for face, dry in self.labellings.fixed.items():
            if (labelling[face] == "d") is not dry:
                fixed = "dry" if dry else "inner"
                raise InputError("labelling", f"letter {face + 1} is {labelling[face]!r}", f"a face that is {fixed}")

    def check(self, reasons: list[Reason]) -> None:
        """Check all reasons; InputError for the first that does not hold, or if labellings remain."""
        for number, reason in enumerate(reasons, len(self.clauses) + 1):
            clause = self.clause(reason)
            if clause is None:
                raise InputError(f"reason {number}", _wrong(reason), "reasons that hold")
            self.clauses[number] = clause
            self._refuted |= not clause
        if not self._refuted:
            raise InputError("reasons", "they leave labellings that may carry more", "a proof that leaves none")

    def clause(self, reason: Reason) -> list[int] | None:
        """Return the clause that a reason proves, or None if the reason does not hold."""
        # The clause is not stored. Its literals are those of `Labellings`.
        if isinstance(reason, Mechanism):
            return self._of_mechanism(reason)
        if isinstance(reason, Lemma):
            literals = list(reason.literals)
            return literals if 0 not in literals and follows(literals, reason.by, self.clauses) else None
        numbers = list(reason.numbers)
        if reason.kind == "slit" and numbers:
            return self.labellings.slit(numbers[0], numbers[1:])
        if reason.kind == "large":
            return self.labellings.too_large(numbers)
        return self.labellings.too_small(numbers) if reason.kind == "small" else None

    def _of_mechanism(self, reason: Mechanism) -> list[int] | None:
        """Return the clause that a mechanism proves, or None if its balance exceeds the bound."""
        if not 0 <= reason.case < len(self._balances):
            return None
        balances, decided = self._balances[reason.case], dict(self.labellings.fixed)
        elements = balances.assembly.elements
        for face, dry in [*((f, True) for f in reason.dry), *((f, False) for f in reason.inner)]:
            if not 0 <= face < self._faces or decided.get(face, dry) is not dry:
                return None
            decided[face] = dry
        for element, velocity in reason.moves.items():
            inside = 0 <= element < len(elements) and not elements.support[element]
            if not inside or len(velocity) != balances.assembly.freedoms:
                return None
        if not balances.weigh(reason.moves, reason.digits, decided).proves(self._bounds[reason.case]):
            return None
        return [*(face + 1 for face in reason.dry), *(-(face + 1) for face in reason.inner)]


def _wrong(reason: Reason) -> str:
    if isinstance(reason, Mechanism):
        return "its mechanism does not prove the bound for all labellings of the reason"
    if isinstance(reason, Lemma):
        return "the lemma does not follow from the reasons it names"
    return f"the rule {reason.kind!r} does not follow from the scene"
