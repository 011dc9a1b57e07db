"""The report of an analysis, and its list of visits: pages that a person reads."""

from app.pages.analysis_report.report import analysis_report
from app.pages.analysis_report.visits import visits_page

__all__ = ["analysis_report", "visits_page"]
