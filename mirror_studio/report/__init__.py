"""Designed mirrors and their measured figures in; HTML reports, their index and the paper's contact sheets out."""

from mirror_studio.report.page import write_report
from mirror_studio.report.paper_page import contact_sheet, table1_markdown, write_index

__all__ = ["contact_sheet", "table1_markdown", "write_index", "write_report"]
