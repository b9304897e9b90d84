"""`workstation robots`: who is alive."""

import sys
from dataclasses import dataclass

import typer

from mbot_workstation.cli.link_options import CertificateOptions, json_option, robots_option
from mbot_workstation.cli.options import with_options


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotsOptions(CertificateOptions):
    """What `robots` takes."""

    robot: list[str] | None = robots_option()
    as_json: bool = json_option()


@with_options
def robots(options: RobotsOptions) -> None:
    """List the robots that are alive, and how they are doing: all enrolled ones, or those named.

    Exit code 4 if an address or a robot did not answer.

    Example: `workstation robots --robot mbot-1 --robot 10.0.0.7`
    """
    import json

    from mbot_protocol.errors import UnreachableError
    from mbot_workstation.fleet.enrolment.enrolled_robots import find_destinations
    from mbot_workstation.fleet.link.fleet import look_around
    from mbot_workstation.wording import fault_lines

    destinations = find_destinations(options.robot or [], options.security())
    reports = look_around(destinations)
    if options.as_json:
        print(json.dumps([report.fields() for report in reports], indent=2))
    else:
        _print_table([report.fields() for report in reports if report.status is not None])
        for report in reports:
            for line in fault_lines(report.status.faults if report.status else ()):
                print(f"{report.robot_id}: {line}")
            for line in fault_lines(report.status.notices if report.status else ()):
                print(f"{report.robot_id}: note: {line}")
            if report.error:
                print(f"workstation: {report.error}", file=sys.stderr)
    if any(report.error for report in reports):
        raise typer.Exit(UnreachableError.exit_code)


def _print_table(rows: list[dict[str, object]]) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from mbot_workstation.wording import one_line, short_digest

    if not rows:
        return
    table = Table(box=None, padding=(0, 2, 0, 0))
    for heading in ("robot", "address", "state", "model", "rate", "missed", "board", "release"):
        table.add_column(heading)
    for row in rows:
        digest = str(row["model_sha256"] or "")
        name = one_line(str(row["model_name"] or ""))
        board = one_line(str(row["board_version"] or "not connected"))
        guard = "" if row["board_has_deadman"] or not row["board_version"] else " (no dead-man)"
        table.add_row(
            str(row["robot_id"]),
            str(row["address"]),
            str(row["state"]) + (" (the hand let go)" if row["hand_let_go"] else ""),
            escape(f"{name} {short_digest(digest)}".strip()),
            f"{row['decision_rate_hz']} Hz",
            str(row["missed_ticks"]),
            escape(board + guard),
            escape(one_line(str(row["release"] or f"none ({row['software_version']})"))),
        )
    console = Console()
    console.print(table, width=None if console.is_terminal else 200)
