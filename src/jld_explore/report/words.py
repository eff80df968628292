"""Describe assemblies and results in words for the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jld_core.assembly import Assembly
from jld_core.build import weight_facts
from jld_core.limit.options import Status
from jld_core.models.tilting import tilt_in_words
from jld_core.scene.cracks import cracks_in_words
from jld_core.scene.schema import Scene
from jld_core.views import facts_of_assembly
from jld_core.views.facts import aligned
from jld_explore.evaluation.protocol import BOUND
from jld_explore.report import tables
from jld_explore.report.columns import COLUMN, ranked_by
from jld_explore.report.reading import Exploration
from jld_explore.report.tables import STANDS
from jld_explore.space import registered
from jld_explore.space.search_space import SearchSpace

if TYPE_CHECKING:
    import pandas as pd

STRONGER_CUT: Final = (  # why a layout may be stronger than the structure without cuts
    "By faces, the structure without these cuts carries at most {high} times the load, less than this layout. "
    "A crack along a face of the cells fails at its tensile or shear strength; the friction of a dry joint grows "
    "with the load that presses on it."
)

LETTERS: Final = 24  # letters of a labelling shown in a terminal


# description of each `stop_reason` of a summary
STOPPED: Final = {
    "exhausted": "nothing left to evaluate",
    "driver": "the driver asks for no more",
    "proven": "the best proven",
    "unproven": "the proof did not pass its check",
    "budget": "budget used up",
    "time": "time limit",
    "interrupted": "interrupted",
}


def assembly(scene: Scene, structure: Assembly, space: SearchSpace) -> str:
    """Describe an assembly and its search space for `jld check`."""
    spots = int(np.count_nonzero(space.candidates))
    return aligned(
        {
            "scene": scene.name,
            **facts_of_assembly(structure),
            **weight_facts(scene, structure),
            "candidates": f"{spots} of {structure.faces} faces may be dry or inner; a labelling says which",
            "symmetries": f"{len(space.group)} (with the identity); labellings alike by symmetry are one class",
        }
    )


def columns(done: Exploration) -> list[str]:
    """Return the names of the columns that a terminal or notebook shows of a study's results."""
    falls = [STANDS] if STANDS in done.results and not done.results[STANDS].fillna(True).all() else []
    integer_counts = [count.name for count in registered() if count.integer]
    counted = dict.fromkeys([*integer_counts, *(name for name, _ in done.scene.search.front.axes)])
    return ["rank", "load_factor", "bracket_lo", "bracket_hi", *falls, *counted, "labelling"]


def facts_of_exploration(done: Exploration) -> dict[str, str]:
    """Return the findings of a study as texts by name, for terminal and notebook."""
    # Findings include classes by status, the stop reason, and the best λ with its proof.
    facts = done.summary.facts
    counted = ", ".join(f"{number} {name}" for name, number in facts["counts_by_status"].items())
    best = "none" if facts["best"] is None else f"{facts['best']:.9g}"
    proof = "proven strongest" if facts["proven"] and facts["best"] is not None else "not proven"
    if facts["best"] is None and facts["proven"]:
        proof = "proven: no layout stands"
    if facts["unbounded"]:
        proof = "but some layouts are locked: they carry any load"
    elif not facts["proven"] and facts["bound"] is not None:
        gap = "" if facts["gap"] is None else f", gap {facts['gap']:.2%}"
        by = f" (bounded {facts['bound_by']})" if " by " in str(facts.get("bound_by")) else ""
        proof += f": none carries more than {facts['bound']:.9g}{by}{gap}"
    if facts.get(STANDS) is False:
        proof = f"{'strongest' if facts['proven'] else 'not proven strongest'} {falls_below(facts)}"
    if facts.get("race", {}).get("decided"):
        proof = f"proven to within {facts['gap']:.1%}: none carries more than {facts['bound']:.6g}"
    nominal = {}
    if facts.get("robust"):
        nominal = {"at nominal": f"{_number(facts['best_nominal'])} (λ above is at the low values)"}
    tried = facts.get("experiment")
    carried = {}
    if tried is not None:
        most = "none stands" if tried["best"] is None else f"most carried {tried['best']:.6g}"
        if tried["none_better"]:
            assumed = tried.get("none_better_assumes")
            most += ", no layout carries more" + (f" (assumed: {assumed})" if assumed else "")
        carried = {"experiments": f"{tried['runs']}: {most}; {tried['not_standing']} do not stand"}
    carried |= _reliability(facts.get("reliability") or {})
    ended = STOPPED[facts["stop_reason"]]
    if "race" in facts and facts["stop_reason"] == "proven" and not facts["proven"]:
        ended = "proven to the gap" if facts["race"]["decided"] else "nothing left to refine"
    # those of the assembly were printed when the search began
    announced = (*done.assembly.warnings, *done.assembly.notes)
    complaints = [line for line in facts.get("warnings", []) if line not in announced]
    falls = 0 if facts.get(STANDS) is False else facts.get("falling", 0)
    once = f"those alike by symmetry once ({facts['labellings']} labellings)"
    return {
        "classes": f"{facts['evaluated']} layouts, {once}: {counted or 'nothing was evaluated'}",
        **({"pruned": f"{facts['pruned']} by a bound, without a solve of their own"} if facts["pruned"] else {}),
        "stopped": f"{ended} after {facts['seconds']:.1f} s{speed(facts['rate'])}",
        **(
            {"required": tables.requirement_words(facts["require"])}
            if facts.get("require")
            else {f"best {ranked_by(done.results)}": f"{best} ({proof})"}
        ),
        **({"ranked last": f"{falls} that fall under their own weight without live load"} if falls else {}),
        **tilt_in_words(done.summary.facts),
        **_anywhere(done),
        **nominal,
        **({"cuts": STRONGER_CUT.format(high=f"{facts['uncut_at_most']:.4g}")} if "uncut_at_most" in facts else {}),
        **_of_blocks(facts.get("fields")),
        **carried,
        **({"next": facts["next"]} if facts.get("next") else {}),
        "cracks": cracks_in_words(done.scene.cracks),
        **({"warning": "; ".join(complaints)} if complaints else {}),
    }


def falls_below(facts: dict[str, Any]) -> str:
    """Return words for a best layout that falls under its dead load alone, as all with a λ then do."""
    least = facts.get("least_load_factor")
    if least is None:
        return "where the live load acts; without it it falls under its own weight, as every layout found does"
    return f"from λ ≥ {least:.6g} on; below that it falls under its own weight, as every layout found does without load"


def speed(rate: float | None) -> str:
    """Return a rate of solves in words, "" where nothing was solved."""
    return f", {rate:.2g} solves/s" if rate and rate < 1.0 else f", {rate:.0f} solves/s" if rate else ""


def _reliability(facts: dict[str, Any]) -> dict[str, str]:
    """Describe the ranking of layouts by their reliability index; {} where nothing was ranked."""
    if not facts.get("layouts"):
        return {}
    best, count = facts["layouts"][0], len(facts["layouts"])
    indices = ", ".join(
        f"{name} {'none' if best[key] is None else f'{best[key]:.4g}'}"
        for name, key in (("first order", "beta_form"), ("simulation", "beta_monte_carlo"))
    )
    return {"reliability": f"of the best {count} by λ, row {best['row']} has the largest β: {indices}"}


def _anywhere(done: Exploration) -> dict[str, str]:
    """Say what the best layout of a search by faces carries wherever its blocks crack; {} if unknown."""
    if "fields_hi" not in done.results or not len(done.results):
        return {}
    low, high = (float(done.results[name].iloc[0]) for name in ("fields_lo", "fields_hi"))
    if high < 0.0:
        return {"anywhere": "wherever its blocks crack, the best falls under its own weight"}
    ends = [f"at least {low:.4g}"] * (low > 0.0) + [f"at most {high:.4g}"] * (high >= 0.0)
    return {"anywhere": f"wherever its blocks crack, the best carries {' and '.join(ends)}"} if ends else {}


def _of_blocks(check: dict[str, Any] | None) -> dict[str, str]:
    """Describe the findings of a check by fields, and the command that continues it."""
    if check is None:
        return {}
    if check["skipped"]:
        return {"by fields": f"not checked: {check['skipped']}"}
    if not check["findings"]:
        return {}
    return {"by fields": "; ".join([*check["findings"], check["next"]])}


# explanation of each status without a rank
MEANINGS: Final = {
    "locked": "no live load brings them down: confined between supports by faces that nothing crushes",
    "uncertified": "a bound of their λ is missing; --solver may find it",
    "unstable": "they fall whatever the live load",
    "failed": "the solve ended without an answer; --resume tries no more",
}


def apart(done: Exploration) -> dict[str, str]:
    """Describe the layouts without a rank, as texts by status."""
    # A text has their number, the meaning of the status, and the command that shows the first. Statuses that no layout
    # has are left out.
    status = done.results["status"]
    texts = {}
    for name, meaning in MEANINGS.items():
        rows = np.flatnonzero((status == name) & (done.results["settled"] != BOUND))
        if len(rows):
            how = f"; jld solve {done.folder} --rank {rows[0] + 1} shows the first"
            texts[name] = f"{len(rows)} layout{'s' if len(rows) > 1 else ''}: {meaning}{how}"
    return texts


def exploration(done: Exploration) -> str:
    """Return the text that `jld explore` prints at its end: findings, ten best rows and front."""
    return "\n".join(
        [
            aligned(facts_of_exploration(done)),
            *([aligned(others)] if (others := apart(done)) else []),
            "",
            _table(best_rows(done, 10)),
            "",
            f"front        {front_name(done)}",
            _table(done.front[[*columns(done), COLUMN]]),
            "",
            f"written to   {done.folder}; a labelling has a letter for each face of faces.csv: d dry, i inner",
        ]
    )


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.9g}"


def _table(rows: pd.DataFrame) -> str:
    """Return rows as text for a terminal, with long labellings shortened."""
    if rows.empty:
        return "none: no layout has a load factor to be ranked by"
    names = [str(name) for name in rows["labelling"]]
    short = [name if len(name) <= LETTERS else f"{name[: LETTERS - 5]}…{name[-4:]}" for name in names]
    return rows.assign(labelling=short).to_string(index=False)


def best_rows(done: Exploration, top: int = 10) -> pd.DataFrame:
    """Return the first `top` rows with status "collapse", for the terminal and the notebook."""
    return done.results[done.results["status"] == str(Status.COLLAPSE)][columns(done)].head(top)


def front_name(done: Exploration) -> str:
    """Return the objectives of the front in words, such as "λ against dry_faces (max)"."""
    return "λ against " + " and ".join(f"{count} ({sense})" for count, sense in done.scene.search.front.axes)
