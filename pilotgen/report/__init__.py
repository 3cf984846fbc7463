"""report.html: what a study found, in words, figures and tables; one file that opens without a network.

SPDX-License-Identifier: BSD-3-Clause
"""

from pilotgen.report.others import read_report_section
from pilotgen.report.write import REPORT_NAME, write_report

__all__ = ["REPORT_NAME", "read_report_section", "write_report"]
