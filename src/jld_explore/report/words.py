"""Words for the terminal: what will be modelled, what came out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from jld_core.assembly import Assembly
from jld_core.limit import LimitAnalysisResult, Status
from jld_core.scene import Scene
from jld_core.views import facts_of_assembly, facts_of_result
from jld_explore.evaluation import BOUND
from jld_explore.report import required
from jld_explore.report.columns import ranked_by
from jld_explore.report.evidence import COLUMN
from jld_explore.report.exploration import Exploration
from jld_explore.space import SearchSpace, registered

if TYPE_CHECKING:
    import pandas as pd

LETTERS: Final = 24
"""Letters of a labelling that are shown of it in a terminal."""


STOPPED: Final = {
    "exhausted": "nothing left to evaluate",
    "proven": "the best proven",
    "budget": "budget used up",
    "time": "time limit",
    "interrupted": "interrupted",
}
"""Why a search ended, by `stop_reason` of its summary."""


def assembly(scene: Scene, found: Assembly, space: SearchSpace) -> str:
    """What `jld check` prints: dimension, counts, loads, program size, candidates, symmetries."""
    spots = int(np.count_nonzero(space.candidates))
    return _lines(
        {
            "scene": scene.name,
            **facts_of_assembly(found),
            "candidates": f"{spots} of {len(found.interfaces)} faces may be dry or inner; a labelling says which",
            "symmetries": f"{len(space.group)} (with the identity); labellings alike by symmetry are one class",
        }
    )


def result(found: LimitAnalysisResult) -> str:
    """What `jld solve` prints."""
    return _lines(facts_of_result(found))


def _lines(facts: dict[str, str]) -> str:
    width = max(12, *(len(name) for name in facts))
    return "\n".join(f"{name:<{width}} {value}" for name, value in facts.items())


def columns(done: Exploration) -> list[str]:
    """What is shown of the tables of a study: all whole counts, and those of its front."""
    whole = [count.name for count in registered() if count.integer]
    counted = dict.fromkeys([*whole, *(name for name, _ in done.scene.search.front.axes)])
    return ["rank", "load_factor", "bracket_lo", "bracket_hi", *counted, "labelling"]


def facts_of_exploration(done: Exploration) -> dict[str, str]:
    """What a study found, by name: classes by status, why it stopped, the best λ and whether that is proven."""
    facts = done.summary
    counted = ", ".join(f"{number} {name}" for name, number in facts["counts_by_status"].items())
    best = "none" if facts["best"] is None else f"{facts['best']:.9g}"
    proof = "proven strongest" if facts["proven"] and facts["best"] is not None else "not proven"
    if facts["best"] is None and facts["proven"]:
        proof = "proven: no layout stands"
    if facts["unbounded"]:
        proof = "but some layouts are locked: they carry any load"
    elif not facts["proven"] and facts["bound"] is not None:
        gap = "" if facts["gap"] is None else f", gap {facts['gap']:.2%}"
        proof += f": none carries more than {facts['bound']:.9g}{gap}"
    nominal = {}
    if facts.get("robust"):
        nominal = {"at nominal": f"{_number(facts['best_nominal'])} (λ above is at the low values)"}
    tried = facts.get("experiment")
    carried = {}
    if tried is not None:
        most = "none stands" if tried["best"] is None else f"most carried {tried['best']:.6g}"
        most += ", no layout carries more" if tried["none_better"] else ""
        carried = {"experiments": f"{tried['runs']}: {most}; {tried['not_standing']} do not stand"}
    spared = {"certificates of other solves": facts["settled"], "a bound": facts["pruned"]}
    ways = " and ".join(f"{number} by {how}" for how, number in spared.items() if number)
    ended = STOPPED[facts["stop_reason"]]
    once = f"those alike by symmetry once ({facts['labellings']} labellings)"
    return {
        "classes": f"{facts['evaluated']} layouts, {once}: {counted or 'nothing was evaluated'}",
        **({"settled": f"{ways}, without a solve of their own"} if ways else {}),
        "stopped": f"{ended} after {facts['seconds']:.1f} s, {facts['rate'] or 0.0:.0f} solves/s",
        **(
            {"required": required.words(facts["require"])}
            if facts.get("require")
            else {f"best {ranked_by(done.results)}": f"{best} ({proof})"}
        ),
        **nominal,
        **carried,
        **({"next": facts["next"]} if facts.get("next") else {}),
    }


MEANINGS: Final = {
    "locked": "no live load brings them down: confined between supports by faces that nothing crushes",
    "uncertified": "nothing is proven of their λ; --gap and --solver may settle them",
    "unstable": "they fall whatever the live load",
    "failed": "the solve ended without an answer; --resume tries no more",
}
"""What a status without a rank means."""


def apart(done: Exploration) -> dict[str, str]:
    """The layouts without a rank, by status: how many, what that means, and how to look at one."""
    status = done.results["status"]
    found = {}
    for name, meaning in MEANINGS.items():
        rows = np.flatnonzero((status == name) & (done.results["settled"] != BOUND))
        if len(rows):
            how = f"; jld solve {done.folder} --rank {rows[0] + 1} shows the first"
            found[name] = f"{len(rows)} layout{'s' if len(rows) > 1 else ''}: {meaning}{how}"
    return found


def exploration(done: Exploration, top: int = 10) -> str:
    """What `jld explore` prints: the best rows, the front, and what is proven."""
    return "\n".join(
        [
            _lines(facts_of_exploration(done)),
            *([_lines(others)] if (others := apart(done)) else []),
            "",
            _table(best_rows(done, top)),
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
    """Rows for a terminal; labellings that a line has no room for are shortened, the whole ones are on disk."""
    if rows.empty:
        return "none: no layout has a load factor to be ranked by"
    short = rows.assign(labelling=[_shortened(str(text)) for text in rows["labelling"]])
    return short.to_string(index=False)


def _shortened(labelling: str) -> str:
    return labelling if len(labelling) <= LETTERS else f"{labelling[: LETTERS - 5]}…{labelling[-4:]}"


def best_rows(done: Exploration, top: int = 10) -> pd.DataFrame:
    """The first rows of the results that have a rank, in the columns that are shown."""
    return done.results[done.results["status"] == str(Status.COLLAPSE)][columns(done)].head(top)


def front_name(done: Exploration) -> str:
    """What the front weighs against what."""
    return "λ against " + " and ".join(f"{count} ({sense})" for count, sense in done.scene.search.front.axes)
