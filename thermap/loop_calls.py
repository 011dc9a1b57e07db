"""The routes that close the loop: verifications, residuals, analyses."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
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


def store_verification(machine: str, verification: Content) -> Call[StoredVerificationAnswer]:
    """Store a `VerificationRequest`: observations to hold the model against."""
    path = of_machine(machine, "verifications")
    return Call("POST", path, reader_of(StoredVerificationAnswer), verification)


def verifications(machine: str) -> Call[list[VerificationAnswer]]:
    """List verifications without their observations, oldest first."""
    return Call("GET", of_machine(machine, "verifications"), reader_of(list[VerificationAnswer]))


def verification(machine: str, verification_id: int) -> Call[WholeVerificationAnswer]:
    """Show one verification with its observations."""
    path = of_machine(machine, "verifications", verification_id)
    return Call("GET", path, reader_of(WholeVerificationAnswer))


def verification_file(machine: str, verification_id: int) -> Call[str]:
    """Write one verification as the CSV file that `import_file` reads."""
    path = of_machine(machine, "verifications", verification_id, "file")
    return Call("GET", path, lambda response: response.text)


def delete_verification(machine: str, verification_id: int) -> Call[None]:
    """Delete a verification; analyses of it keep their results."""
    return Call("DELETE", of_machine(machine, "verifications", verification_id), nothing)


def watch(machine: str) -> Call[WatchAnswer]:
    """Say whether the machine still is as its model says, by a sequential test."""
    return Call("GET", of_machine(machine, "watch"), reader_of(WatchAnswer))


def verification_residuals(
    machine: str, verification_id: int, model_version: int | None = None, rows: int = 0
) -> Call[ResidualsAnswer]:
    """Subtract what a model version says from one verification, with so many single rows."""
    path = of_machine(machine, "verifications", verification_id, "residuals")
    query = {"model_version": model_version, "rows": rows}
    return Call("GET", path, reader_of(ResidualsAnswer), query=query)


def residuals(
    machine: str, verifications: Sequence[int], model_version: int | None = None, rows: int = 0
) -> Call[ResidualsAnswer]:
    """Do the same with several verifications together."""
    body = {"verifications": list(verifications), "model_version": model_version, "rows": rows}
    return Call("POST", of_machine(machine, "residuals"), reader_of(ResidualsAnswer), body)


def residuals_page(
    machine: str, verifications: Sequence[int], model_version: int | None = None
) -> Call[str]:
    """Read residuals as a page for a person: HTML that needs no other file."""
    body = {"verifications": list(verifications), "model_version": model_version}
    path = of_machine(machine, "residuals")
    return Call("POST", path, lambda response: response.text, body, headers={"Accept": HTML})


def compare_models(
    machine: str, verifications: Sequence[int], versions: Sequence[int]
) -> Call[ModelComparisonAnswer]:
    """Show versions side by side, on the observations that all can be held against."""
    body = {"verifications": list(verifications), "versions": list(versions)}
    path = of_machine(machine, "models", "compare")
    return Call("POST", path, reader_of(ModelComparisonAnswer), body)


def analyse(machine: str, question: Content) -> Call[AnalysisHead]:
    """Ask for an analysis with an `AnalysisRequest`; look at it until it is done."""
    return Call("POST", of_machine(machine, "analyses"), reader_of(AnalysisHead), question)


def plan_analysis(machine: str, plan: Content) -> Call[PlanAnswer]:
    """Say what the observations of a `PlanRequest` could see, before anyone measures."""
    path = of_machine(machine, "analyses", "plan")
    return Call("POST", path, reader_of(PlanAnswer), plan, patience_s=PLANNING_S)


def fleet(effects: Sequence[str] | None = None, holdout_fraction: float = 0.3) -> Call[FleetAnswer]:
    """Say how far the analyses of all machines are, and what they say together."""
    query = {
        "effects": None if effects is None else list(effects),
        "holdout_fraction": holdout_fraction,
    }
    return Call("GET", "/v1/fleet", reader_of(FleetAnswer), query=query, patience_s=PLANNING_S)


def analyse_fleet(question: Content) -> Call[FleetAnswer]:
    """Ask for the analyses that are missing with a `FleetRequest`."""
    return Call("POST", "/v1/fleet/analyses", reader_of(FleetAnswer), question)


def cancel_fleet(question: Content) -> Call[FleetAnswer]:
    """Cancel those that wait or run of the analyses that asked a `FleetRequest`."""
    return Call("POST", "/v1/fleet/analyses/cancel", reader_of(FleetAnswer), question)


def try_effect(question: Content) -> Call[TriedEffectAnswer]:
    """Hold an effect that was found on one machine, as it stands, against another one."""
    path = "/v1/fleet/tried-effects"
    return Call("POST", path, reader_of(TriedEffectAnswer), question, patience_s=PLANNING_S)


def analyses(machine: str) -> Call[list[AnalysisHead]]:
    """List analyses without their results, oldest first."""
    return Call("GET", of_machine(machine, "analyses"), reader_of(list[AnalysisHead]))


def analysis(machine: str, analysis_id: int) -> Call[AnalysisAnswer]:
    """Show how far an analysis is and, once it is done, what it found."""
    return Call("GET", of_machine(machine, "analyses", analysis_id), reader_of(AnalysisAnswer))


def analysis_report(machine: str, analysis_id: int) -> Call[str]:
    """Read an analysis as a page for a person: HTML that needs no other file."""
    path = of_machine(machine, "analyses", analysis_id, "report")
    return Call("GET", path, lambda response: response.text)


def visits_page(machine: str, analysis_id: int) -> Call[str]:
    """Read the visits that an analysis proposes as a page to print and to write on."""
    path = of_machine(machine, "analyses", analysis_id, "visits")
    return Call("GET", path, lambda response: response.text)


def visit_file(machine: str, analysis_id: int, visit: int) -> Call[str]:
    """Write a visit that an analysis proposes, from 1, as the CSV file that planning reads."""
    path = of_machine(machine, "analyses", analysis_id, "visits", visit)
    return Call("GET", path, lambda response: response.text)


def cancel_analysis(machine: str, analysis_id: int) -> Call[AnalysisHead]:
    """Cancel an analysis that waits or runs."""
    path = of_machine(machine, "analyses", analysis_id, "cancel")
    return Call("POST", path, reader_of(AnalysisHead))


def delete_analysis(machine: str, analysis_id: int) -> Call[None]:
    """Delete an analysis; a model version that was made of it stays."""
    return Call("DELETE", of_machine(machine, "analyses", analysis_id), nothing)


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
    machine: str,
    analysis_id: int,
    effects: Sequence[int] | None = None,
    *,
    onto_active: bool = False,
    accept_losses: bool = False,
) -> Call[ChangedModelAnswer]:
    """Make the next, active model version with effects that an analysis found."""
    path = of_machine(machine, "analyses", analysis_id, "adopt")
    body = _adoption(effects, onto_active)
    return Call("POST", path, reader_of(ChangedModelAnswer), body, query=accepting(accept_losses))


def preview_adoption(
    machine: str,
    analysis_id: int,
    effects: Sequence[int] | None = None,
    *,
    onto_active: bool = False,
) -> Call[PreviewAnswer]:
    """Say what adopting effects would do to the tables; nothing changes."""
    path = of_machine(machine, "analyses", analysis_id, "adopt")
    body = _adoption(effects, onto_active)
    return Call("POST", path, reader_of(PreviewAnswer), body, query=PREVIEW)


def _adoption(effects: Iterable[int] | None, onto_active: bool) -> dict[str, Any]:
    chosen = {} if effects is None else {"effects": list(effects)}
    return {"onto_active": onto_active, **chosen}
