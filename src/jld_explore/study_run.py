"""Run a study to its end or to a signal, and leave its record as a resumed search needs it."""

from __future__ import annotations

from contextlib import suppress
from typing import Final

from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.models import cost_estimate
from jld_explore.driver_choice import nothing_found
from jld_explore.drivers.choice import bound_of_all, first_layout
from jld_explore.report import write_report
from jld_explore.report.folder import write_tables
from jld_explore.space.labelling import orbit_sizes
from jld_explore.study import Study
from jld_explore.study_state import Interrupted, StopReason

# Expected time of the bound on all labellings, as a multiple of the time of one labelling. The bound is omitted if it
# would be late.
_BOUNDING: Final = 5.0

STOPPING: Final = 0.5
"""Seconds after the end of a search for the bound on all labellings.

After an interrupt it also limits the solves for the page, which shows forces of the best layout unless solving it takes
long.
"""

_FOUND: Final = 1.2  # time to find and evaluate a first layout after a signal, s


def run_study(study: Study, deadline: Deadline) -> StopReason:
    """Run a study and bound all labellings if no other bound is known.

    Result: reason why the search ended. Raises InputError if no labelling was found; the files of the search are
    removed. Raises Interrupted if a signal arrived.
    """
    # If the search is interrupted, its tables are written before the exception continues.
    try:
        reason = study.run()
        cost = _BOUNDING * cost_estimate(study.assembly).seconds
        if len(study.records) and reason not in (StopReason.PROVEN, StopReason.EXHAUSTED) and study.bound is None:
            _bound_all(study, in_time=cost < deadline.remaining() + STOPPING)
    except BaseException as stop:
        # A signal may arrive between writing to disk and updating memory, so reopen the record on disk.
        study.records.close()
        apart = False
        if isinstance(stop, Interrupted):
            study.records = study.open_records()
            apart = _solve_first(study)
            study.records.close()
        _bound_all(study, in_time=_BOUNDING * cost_estimate(study.assembly).seconds < STOPPING)
        done = write_tables(study, StopReason.INTERRUPTED, Deadline(STOPPING))
        if study.settings.pictures:
            write_report(done, patience=STOPPING, deadline=Deadline(0.0))
        if apart:
            study.records = study.open_records()
            study.records.forget_evaluations()
            study.records.close()
        if isinstance(stop, Interrupted):
            stop.done = done
            if not len(done.results):
                stop.words = "stopped before a layout was solved; --resume begins with the first"
        raise
    if not len(study.records) and reason in (StopReason.EXHAUSTED, StopReason.PROVEN, StopReason.TIME):
        # The space, too large to count beforehand, is empty, or no labelling was found in time.
        for path in (study.records.path, study.folder / "scene.json"):
            path.unlink(missing_ok=True)
        if not any(study.folder.iterdir()):
            study.folder.rmdir()
        raise nothing_found(study.space, study.settings.seconds if reason is StopReason.TIME else None)
    return reason


def _solve_first(study: Study) -> bool:
    """Evaluate one layout without the driver if none is on record, and record it; return True if it was."""
    # The record must be open. Nothing happens where one layout is not found and evaluated within a second. The caller
    # forgets the layout again, so that the search resumes as if it had not been stopped.
    left = _FOUND - study.evaluation_seconds
    if len(study.records) or left <= 0.0:
        return False
    with suppress(DeadlinePassed), Deadline(left).enforced():
        found = first_layout(study.space, study.settings.seed)
        evaluations = study.worker_spec.evaluator().evaluate_all(found)
        study.records.append(found, orbit_sizes(found, study.space.group).tolist(), evaluations)
    return len(study.records) > 0


def _bound_all(study: Study, *, in_time: bool) -> None:
    """Record a bound on λ of all labellings if the study has none and `in_time` is True.

    in_time: True if the caller expects the bound in the time left. The records are reopened from disk first and closed
    at the end. No bound is recorded if `scene.cracks` is not "faces", or the objective is the user's own.
    """
    study.records = study.open_records()
    if study.bound is None and in_time and study.scene.cracks == "faces" and study.settings.own_objective is None:
        study.keep_bound(bound_of_all(study.space, study.settings.model), "faces")
    study.records.close()
