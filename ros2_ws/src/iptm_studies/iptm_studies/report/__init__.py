"""The reproduction of the paper as a page: tables, figures and a verdict per statement, from stored runs."""

from iptm_studies.report.building import build_report

__all__ = ["build_report"]
