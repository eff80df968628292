"""Hard cases: status, bracket, solves and the route that each one took, with the fallbacks named.

Every case must end with a bracket no wider than 1e-6 or say `uncertified`, and none with a wrong number. λ to compare
with: a closed form, or else the same problem stated in CVXPY and solved by simplex (spatial: published).
"""

from __future__ import annotations

import math
import time
import warnings
from collections import Counter
from dataclasses import dataclass
from typing import Final

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.common import RESULTS, about, table, write
from benchmarks.hard_scenes import HardCase, hard_cases, is_near
from benchmarks.stated import stated
from jld_core import LimitAnalysisResult, Status, solve
from jld_core.views.figures import save_figure

WIDE: Final = 1e-6


@dataclass(frozen=True)
class Verdict:
    """What came out of one case, beside what should have; right: True, False, or None where it was left open."""

    case: HardCase
    found: LimitAnalysisResult
    expected: float
    seconds: float

    @property
    def right(self) -> bool | None:
        """None: honestly uncertified."""
        if self.found.status is Status.UNCERTIFIED:
            return None
        if self.found.status is not self.case.status:
            return False
        if self.found.status is not Status.COLLAPSE:
            return True
        return self.found.gap <= WIDE and is_near(self.found.load_factor, self.case, self.expected)


def judge(case: HardCase) -> Verdict:
    """Solve one case and compare."""
    assembly = case.make()
    labels = assembly.labels if case.labels is None else case.labels(assembly)
    start = time.process_time()
    found = solve(assembly, labels)
    seconds = time.process_time() - start
    expected = math.nan if case.expected is None else case.expected
    if case.status is Status.COLLAPSE and case.expected is None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # badly scaled data is what these cases are about
            expected = stated(assembly, labels, "HIGHS")
    return Verdict(case, found, expected, seconds)


def row_of(verdict: Verdict) -> list[str]:
    """One line of the table."""
    found, case = verdict.found, verdict.case
    low, high = found.bracket
    bracket = "" if math.isnan(low) else f"[{low:.9g}, {'∞' if math.isnan(high) else f'{high:.9g}'}]"
    off = abs(found.load_factor - verdict.expected)
    close = f"{off / max(abs(verdict.expected), 1e-3):.0e}" if math.isfinite(off) else ""
    return [
        case.kind,
        case.name,
        str(found.status),
        bracket,
        f"{found.gap:.0e}" if math.isfinite(found.gap) else "",
        close,
        {True: "yes", False: "**no**", None: "left open"}[verdict.right],
        str(found.iterations),
        f"{verdict.seconds:.3g}",
        " → ".join(found.solve_log),
    ]


LEAST: Final = 1e-16
"""Width at which an exact bracket is drawn."""
LOOKS: Final = {
    "bracket, first solve": ("o", "#2166ac"),
    "bracket, after fallbacks": ("D", "#e08214"),
    "locked or unstable, proven": ("s", "#1b7837"),
    "uncertified": ("X", "#b2182b"),
}


def look_of(verdict: Verdict) -> str:
    """How a case is drawn."""
    if verdict.found.status is Status.UNCERTIFIED:
        return "uncertified"
    if verdict.found.status is not Status.COLLAPSE:
        return "locked or unstable, proven"
    return "bracket, first solve" if len(verdict.found.solve_log) == 1 else "bracket, after fallbacks"


def draw(verdicts: list[Verdict]) -> Figure:
    """Cases from top to bottom; left the relative width of the bracket, right the time."""
    figure = Figure(figsize=(11.0, 0.19 * len(verdicts) + 1.6), dpi=110, layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=[3, 2])
    for place, verdict in enumerate(verdicts):
        marker, colour = LOOKS[look_of(verdict)]
        gap = verdict.found.gap
        at = max(gap, LEAST) if math.isfinite(gap) else LEAST
        left.plot(at, place, marker, color=colour, ms=6, alpha=1.0 if math.isfinite(gap) else 0.6)
        right.plot(verdict.seconds, place, marker, color=colour, ms=6)
    for ax in (left, right):
        ax.set_xscale("log")
        ax.grid(True, color="0.92", lw=0.6)
    left.axvline(WIDE, color="0.4", lw=0.8, ls="--")
    left.set_yticks(range(len(verdicts)), [str(verdict.case) for verdict in verdicts], fontsize=7)
    left.invert_yaxis()
    left.set_ylim(len(verdicts) - 0.4, -0.6)
    left.set_xlabel(f"relative width of the bracket ({LEAST:.0e}: exact, or none)")
    right.set_xlabel("processor time, s")
    handles = [Line2D([], [], ls="", marker=m, color=c, label=name) for name, (m, c) in LOOKS.items()]
    figure.legend(handles=handles, loc="outside upper center", ncols=4, frameon=False, fontsize=9)
    return figure


def main() -> None:
    """Solve all cases and write benchmarks/results/hard_cases.md and .png."""
    verdicts = [judge(case) for case in hard_cases()]
    head = ["what is hard", "which", "status", "bracket", "gap", "off by", "right", "programs", "s", "route"]
    counted = Counter(verdict.right for verdict in verdicts)
    first = sum(len(verdict.found.solve_log) == 1 for verdict in verdicts)
    save_figure(draw(verdicts), RESULTS / "hard_cases.png")
    text = about(__doc__)
    summary = (
        f"{len(verdicts)} cases: {counted[True]} right, {counted[None]} honestly uncertified, {counted[False]} wrong; "
        f"{first} by the first solve alone. Off by: |λ − expected| over |expected|, or over 1e-3 where that is larger. "
        "Programs: solved in all, with that for standing at λ = 0. Route: an arrow begins a fallback, in brackets what "
        "a solver said that was not `optimal`.\n\n![Width of the bracket and time by case](hard_cases.png)"
    )
    rows = table(head, [row_of(verdict) for verdict in verdicts])
    write("hard_cases", f"# Hard cases\n\n{text}\n\n{summary}\n\n{rows}")


if __name__ == "__main__":
    main()
