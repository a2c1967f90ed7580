"""The report: one self-contained page that shows what a comparison found."""

from agents.benchmark.report.page import write_report

__all__ = ["write_report"]
