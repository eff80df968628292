"""Summary of a finished search, by named fields."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any


@dataclass(frozen=True)
class Summary:
    """Outcome of a search: the best layout, its proof, and how it was found.

    The fields are the entries of summary.json that every search has; `facts` has the others too.

    Attributes
    ----------
    best : float or None
        Largest load factor of the objective, scene units; None if no layout has one.
    best_labelling : str or None
        Letters d and i of that layout, in the order of faces.csv.
    unbounded : bool
        True if some layout is locked and carries any load.
    proven : bool
        True if no layout carries more than `best`.
    stands_at_zero : bool or None
        False if that layout falls under its dead load alone, as every layout with a load factor then does.
    bound : float or None
        Proven upper bound on λ of all layouts; None without one.
    gap : float or None
        Relative difference between `best` and `bound`.
    stop_reason : str
        Reason why the search ended.
    classes : int or None
        Number of layouts, those equal by symmetry counted once; None if unknown.
    labellings : int
        Number of layouts evaluated, symmetric images included.
    evaluated : int
        Number of classes evaluated.
    solved : int
        Number of classes solved in this run.
    settled, pruned : int
        `settled` is 0. `pruned` is the number of classes settled by a bound.
    counts_by_status : dict of str to int
        Number of classes by status.
    seconds : float
        Duration, s.
    rate : float or None
        Classes solved per second.
    driver : str
        Name of the driver.
    seed : int
        Seed of the driver.
    warnings : list of str
        Warnings about the scene and the search, and how bounds by fields differ from λ by faces.
    front : list of dict
        Points of the front: `count`, `load_factor`, `bound`, `proven`.
    next : str or None
        Advice on how to complete a proof; None if there is none.
    cracks : str or dict
        Crack model of λ, as in a scene.
    by_fields : [float or None, float or None] or None
        Bounds on λ of the best layout where its blocks may crack anywhere; None where unknown.
    uncut : [float or None, float or None] or None
        The same of the structure without cuts; None where unknown.
    facts : dict
        All entries of summary.json, also those of a single driver or option.
    """

    best: float | None
    best_labelling: str | None
    unbounded: bool
    proven: bool
    bound: float | None
    gap: float | None
    stop_reason: str
    labellings: int
    evaluated: int
    counts_by_status: dict[str, int]
    seconds: float
    rate: float | None
    driver: str
    classes: int | None = None
    stands_at_zero: bool | None = None
    solved: int = 0
    settled: int = 0
    pruned: int = 0
    seed: int = 0
    warnings: list[str] = field(default_factory=list)
    front: list[dict[str, Any]] = field(default_factory=list)
    next: str | None = None
    cracks: Any = "faces"
    by_fields: list[float | None] | None = None
    uncut: list[float | None] | None = None
    facts: dict[str, Any] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, facts: Mapping[str, Any]) -> Summary:
        """Make a summary from the content of summary.json.

        Parameters
        ----------
        facts : mapping of str to object
            Content of summary.json; all of it is kept in `facts`.

        Returns
        -------
        Summary
            The summary.

        Raises
        ------
        TypeError
            If a field without a default is missing.
        """
        known = {one.name for one in fields(cls)} - {"facts", "warnings"}
        found = [*facts.get("warnings", []), *(facts.get("fields") or {}).get("findings", [])]
        return cls(**{name: value for name, value in facts.items() if name in known}, warnings=found, facts=dict(facts))

    def to_json(self) -> dict[str, Any]:
        """Return the content of summary.json as a new dict."""
        return dict(self.facts)
