"""The routes that close the loop: verifications, residuals, analyses."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from time import monotonic
from typing import Any, Final, TypeAlias

from thermap.answers import (
    AnalysisAnswer,
    AnalysisHead,
    ChangedModelAnswer,
    FleetAnswer,
    ModelComparisonAnswer,
    PlanAnswer,
    PreviewAnswer,
    ResidualsAnswer,
    StoredVerificationAnswer,
    TriedEffectAnswer,
    VerificationAnswer,
    WatchAnswer,
    WholeVerificationAnswer,
)
from thermap.call import Call, Content, nothing, reader_of
from thermap.calls import HTML, PREVIEW, accepting, of_machine
from thermap.errors import NotAnalysedError

Progress: TypeAlias = Callable[[float, str], object]
"""Is told the share that is done, and what is being done."""

POLL_S: Final = 0.3
"""Between two looks at an analysis [s]."""

PLANNING_S: Final = 600.0
"""A plan of many visits is computed while its request waits [s]."""


def store_verification(machine_id: str, verification: Content) -> Call[StoredVerificationAnswer]:
    """POST …/verifications."""
    path = of_machine(machine_id, "verifications")
    return Call("POST", path, reader_of(StoredVerificationAnswer), verification)


def verifications(machine_id: str) -> Call[list[VerificationAnswer]]:
    """GET …/verifications."""
    return Call("GET", of_machine(machine_id, "verifications"), reader_of(list[VerificationAnswer]))


def verification(machine_id: str, number: int) -> Call[WholeVerificationAnswer]:
    """GET …/verifications/{id}."""
    path = of_machine(machine_id, "verifications", number)
    return Call("GET", path, reader_of(WholeVerificationAnswer))


def verification_file(machine_id: str, number: int) -> Call[str]:
    """GET …/verifications/{id}/file, as CSV."""
    path = of_machine(machine_id, "verifications", number, "file")
    return Call("GET", path, lambda response: response.text)


def delete_verification(machine_id: str, number: int) -> Call[None]:
    """DELETE …/verifications/{id}."""
    return Call("DELETE", of_machine(machine_id, "verifications", number), nothing)


def watch(machine_id: str) -> Call[WatchAnswer]:
    """GET …/watch."""
    return Call("GET", of_machine(machine_id, "watch"), reader_of(WatchAnswer))


def verification_residuals(
    machine_id: str, number: int, model_version: int | None, rows: int
) -> Call[ResidualsAnswer]:
    """GET …/verifications/{id}/residuals."""
    path = of_machine(machine_id, "verifications", number, "residuals")
    query = {"model_version": model_version, "rows": rows}
    return Call("GET", path, reader_of(ResidualsAnswer), query=query)


def residuals(
    machine_id: str, verifications: Iterable[int], model_version: int | None, rows: int
) -> Call[ResidualsAnswer]:
    """POST …/residuals."""
    body = {"verifications": list(verifications), "model_version": model_version, "rows": rows}
    return Call("POST", of_machine(machine_id, "residuals"), reader_of(ResidualsAnswer), body)


def residuals_page(
    machine_id: str, verifications: Iterable[int], model_version: int | None
) -> Call[str]:
    """POST …/residuals, as a page."""
    body = {"verifications": list(verifications), "model_version": model_version}
    path = of_machine(machine_id, "residuals")
    return Call("POST", path, lambda response: response.text, body, headers={"Accept": HTML})


def compare_models(
    machine_id: str, verifications: Iterable[int], versions: Iterable[int]
) -> Call[ModelComparisonAnswer]:
    """POST …/models/compare."""
    body = {"verifications": list(verifications), "versions": list(versions)}
    path = of_machine(machine_id, "models", "compare")
    return Call("POST", path, reader_of(ModelComparisonAnswer), body)


def analyse(machine_id: str, question: Content) -> Call[AnalysisHead]:
    """POST …/analyses."""
    return Call("POST", of_machine(machine_id, "analyses"), reader_of(AnalysisHead), question)


def plan_analysis(machine_id: str, plan: Content) -> Call[PlanAnswer]:
    """POST …/analyses/plan."""
    path = of_machine(machine_id, "analyses", "plan")
    return Call("POST", path, reader_of(PlanAnswer), plan, patience_s=PLANNING_S)


def fleet(effects: Iterable[str] | None, holdout_fraction: float) -> Call[FleetAnswer]:
    """GET /v1/fleet."""
    query = {
        "effects": None if effects is None else list(effects),
        "holdout_fraction": holdout_fraction,
    }
    return Call("GET", "/v1/fleet", reader_of(FleetAnswer), query=query, patience_s=PLANNING_S)


def analyse_fleet(question: Content) -> Call[FleetAnswer]:
    """POST /v1/fleet/analyses."""
    return Call("POST", "/v1/fleet/analyses", reader_of(FleetAnswer), question)


def cancel_fleet(question: Content) -> Call[FleetAnswer]:
    """POST /v1/fleet/analyses/cancel."""
    return Call("POST", "/v1/fleet/analyses/cancel", reader_of(FleetAnswer), question)


def try_effect(question: Content) -> Call[TriedEffectAnswer]:
    """POST /v1/fleet/tried-effects."""
    path = "/v1/fleet/tried-effects"
    return Call("POST", path, reader_of(TriedEffectAnswer), question, patience_s=PLANNING_S)


def analyses(machine_id: str) -> Call[list[AnalysisHead]]:
    """GET …/analyses."""
    return Call("GET", of_machine(machine_id, "analyses"), reader_of(list[AnalysisHead]))


def analysis(machine_id: str, number: int) -> Call[AnalysisAnswer]:
    """GET …/analyses/{id}."""
    return Call("GET", of_machine(machine_id, "analyses", number), reader_of(AnalysisAnswer))


def analysis_report(machine_id: str, number: int) -> Call[str]:
    """GET …/analyses/{id}/report."""
    path = of_machine(machine_id, "analyses", number, "report")
    return Call("GET", path, lambda response: response.text)


def visits_page(machine_id: str, number: int) -> Call[str]:
    """GET …/analyses/{id}/visits."""
    path = of_machine(machine_id, "analyses", number, "visits")
    return Call("GET", path, lambda response: response.text)


def visit_file(machine_id: str, number: int, visit: int) -> Call[str]:
    """GET …/analyses/{id}/visits/{number}, as CSV."""
    path = of_machine(machine_id, "analyses", number, "visits", visit)
    return Call("GET", path, lambda response: response.text)


def cancel_analysis(machine_id: str, number: int) -> Call[AnalysisHead]:
    """POST …/analyses/{id}/cancel."""
    path = of_machine(machine_id, "analyses", number, "cancel")
    return Call("POST", path, reader_of(AnalysisHead))


def delete_analysis(machine_id: str, number: int) -> Call[None]:
    """DELETE …/analyses/{id}."""
    return Call("DELETE", of_machine(machine_id, "analyses", number), nothing)


class Waiting:
    """Looks at an analysis again and again until it has ended.

    Parameters
    ----------
    progress
        Called with the share that is done, 0 to 1, and what is being done, each time.
    timeout_s
        Longest wait [s]; None for as long as it takes.
    """

    def __init__(self, progress: Progress | None, timeout_s: float | None) -> None:
        self._progress = progress
        self._timeout_s = timeout_s
        self._end_s = None if timeout_s is None else monotonic() + timeout_s

    def goes_on(self, job: AnalysisAnswer) -> bool:
        """Say whether to look again.

        Raises
        ------
        NotAnalysedError
            If it failed or was cancelled.
        TimeoutError
            If it has taken too long; it goes on nevertheless.
        """
        if self._progress is not None:
            self._progress(job.progress, job.message or job.status)
        if job.status in ("failed", "cancelled"):
            why = f": {job.message}" if job.message else ""
            raise NotAnalysedError(f"analysis {job.id} {job.status}{why}")
        if job.status == "done":
            return False
        if self._end_s is not None and monotonic() >= self._end_s:
            raise TimeoutError(
                f"analysis {job.id} is {job.status} after {self._timeout_s:g} s, and goes on"
            )
        return True


def adopt_analysis(
    machine_id: str,
    number: int,
    effects: Iterable[int] | None,
    onto_active: bool,
    accept_losses: bool = False,
) -> Call[ChangedModelAnswer]:
    """POST …/analyses/{id}/adopt."""
    path = of_machine(machine_id, "analyses", number, "adopt")
    body = _adoption(effects, onto_active)
    return Call("POST", path, reader_of(ChangedModelAnswer), body, query=accepting(accept_losses))


def preview_adoption(
    machine_id: str, number: int, effects: Iterable[int] | None, onto_active: bool
) -> Call[PreviewAnswer]:
    """POST …/analyses/{id}/adopt?preview=true."""
    path = of_machine(machine_id, "analyses", number, "adopt")
    body = _adoption(effects, onto_active)
    return Call("POST", path, reader_of(PreviewAnswer), body, query=PREVIEW)


def _adoption(effects: Iterable[int] | None, onto_active: bool) -> dict[str, Any]:
    chosen = {} if effects is None else {"effects": list(effects)}
    return {"onto_active": onto_active, **chosen}
