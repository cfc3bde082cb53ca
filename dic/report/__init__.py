"""Writes reports as single HTML files; the report on runs compares them with Helm and Deaner's paper."""

from dic.report.page import write_report

__all__ = ["write_report"]
