"""HTML and PDF reports of designed mirrors, their tables and the paper's sheets."""

from mirror_studio.report.page import write_report
from mirror_studio.report.paper_page import contact_sheet, table1_markdown, write_index
from mirror_studio.report.pdf import write_pdf
from mirror_studio.report.report_data import ReportData, find, write_findings

__all__ = ["ReportData", "contact_sheet", "find", "table1_markdown", "write_findings", "write_index", "write_pdf",
           "write_report"]
