"""Residuals as a page: what a model version leaves of verifications, and what it depends on."""

from app.pages.residuals_page.head import ResidualsHead
from app.pages.residuals_page.page import residuals_page

__all__ = ["ResidualsHead", "residuals_page"]
