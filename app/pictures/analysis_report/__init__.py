"""The report of an analysis: one page that a person reads, and the words it is written in."""

from app.pictures.analysis_report.head import ReportHead
from app.pictures.analysis_report.report import analysis_report

__all__ = ["ReportHead", "analysis_report"]
