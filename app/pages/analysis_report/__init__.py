"""The report of an analysis: one page that a person reads."""

from app.pages.analysis_report.report import analysis_report

__all__ = ["analysis_report"]
