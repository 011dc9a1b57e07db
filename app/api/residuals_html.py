"""Residuals as a page for a person, of what the same route answers as JSON."""

from __future__ import annotations

from app.identification.analysis.residual_curves import residual_curves
from app.pages.residuals_page import ResidualsHead, residuals_page
from app.services.residuals import ShownResiduals


def residuals_html(shown: ShownResiduals) -> str:
    """Write residuals as HTML that needs no other file."""
    residuals = shown.report.residuals
    machine, times_s = residuals.projection.model.machine, residuals.rows.times_s
    head = ResidualsHead(
        machine_id=machine.id,
        machine_name=machine.name,
        chain=machine.chain.text,
        model_version=shown.model_version,
        verifications=[(v.label, str(v.datum)) for v in shown.verifications],
        first_s=float(times_s.min()),
        last_s=float(times_s.max()),
    )
    return residuals_page(head, shown.report, residual_curves(shown.report))
