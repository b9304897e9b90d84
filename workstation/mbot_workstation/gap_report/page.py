"""The report as one HTML page that needs nothing else."""

from html import escape

from mbot_workstation.gap_report.camera_section import camera_section
from mbot_workstation.gap_report.driving_section import driving_section
from mbot_workstation.gap_report.page_style import STYLE
from mbot_workstation.gap_report.parameter_section import parameter_section
from mbot_workstation.gap_report.report import GapReport
from mbot_workstation.gap_report.summary_section import summary_section
from mbot_workstation.gap_report.verdict_section import verdict_section


def page(report: GapReport) -> str:
    """The whole page."""
    title = f"Gap report: {report.robot_id}, {report.made_on}"
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en">',
            "<head>",
            '<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(title)}</title>",
            f"<style>{STYLE}</style>",
            "</head>",
            "<body><main>",
            summary_section(report),
            verdict_section(report),
            driving_section(report),
            camera_section(report),
            parameter_section(report.files),
            f"<footer>{escape(title)}, by <code>workstation gap-report</code>.</footer>",
            "</main></body></html>",
            "",
        ]
    )
