"""When something is wrong: one file for somebody who helps, and what was in the way before."""

from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.common_options import LinkOptions, json_option
from mbot_workstation.cli.options import (
    argument,
    check_new_file,
    option,
    output_file,
    with_options,
)
from mbot_workstation.cli.presenter import Answer, plain, table
from mbot_workstation.wording import typed

NEWEST_DRIVES = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class SupportOptions(LinkOptions):
    """What `support` takes."""

    output: Path = output_file(
        Path("mbot-support.tar.gz"), "A new file.", "--output", "-o", metavar="FILE.tar.gz"
    )
    configuration: Path | None = option(
        None,
        "A robot's configuration on this machine: it, and what `mbot-agent check` says.",
        "--config",
        metavar="robot.toml",
    )
    as_json: bool = json_option()


@dataclass(frozen=True, slots=True)
class Packed:
    """An archive, and what is in it."""

    output: Path
    files: list[str]


@with_options
def support(options: SupportOptions) -> Answer:
    """Pack what somebody who helps will ask for: versions, state, faults, models, recordings.

    Nothing is sent anywhere. Keys and certificates are left out, passwords and logins in addresses
    replaced; names of robots, people, hosts and networks are not. Where no robot answers, the file
    says why.

    Example: `workstation support --config robot.toml -o mbot-support.tar.gz`
    """
    from mbot_workstation.fleet.support.archive import (
        FOLDER,
        of_configuration,
        of_robot,
        of_this_machine,
        write_archive,
    )

    check_new_file(options.output)
    files = of_configuration(options.configuration) if options.configuration else {}
    files |= of_this_machine() | of_robot(options.link) | _history()
    write_archive(options.output, files)
    packed = Packed(options.output, sorted(files))
    look = f"tar -xzf {typed(options.output)} and look into {FOLDER} before you hand it on"
    return Answer(packed, [f"{options.output}: {', '.join(packed.files)}", f"next: {look}"])


def _history() -> dict[str, str]:
    """What the newest of the fetched drives tell of faults; nothing where none were fetched."""
    from mbot_workstation.fleet.support.archive import json_text
    from mbot_workstation.look.collect.fault_history import faults_in
    from mbot_workstation.look.collect.reviews import drives_in

    try:
        newest = sorted(drives_in(Path("drives")), key=lambda path: path.name)[-NEWEST_DRIVES:]
    except ConfigurationError:
        return {}
    try:
        return {"faults.json": json_text(plain(faults_in(newest)))}
    except ConfigurationError as error:
        return {"faults.json": json_text({"error": str(error)})}


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultsOptions:
    """What `faults` takes."""

    recordings: list[Path] | None = argument(
        "Recordings; all fetched ones, in the folder drives, if not given.",
        default=None,
        metavar="[RECORDING]...",
    )
    as_json: bool = json_option()


@with_options
def faults(options: FaultsOptions) -> Answer:
    """List what has kept robots from driving, by the drives they have recorded; newest first.

    What is in the way now, `workstation robots` says. A robot records while it is armed:
    `workstation recordings fetch --all` brings those drives here.

    Example: `workstation faults drives/mbot-1/drive-0012-20261122-171501`
    """
    from mbot_workstation.look.collect.fault_history import faults_in
    from mbot_workstation.look.collect.reviews import drives_in

    found = faults_in(options.recordings or drives_in(Path("drives")))
    if not found:
        return Answer(found, ["no faults in these drives"])
    headings = ("began", "lasted", "robot", "fault", "what to do")
    return Answer(found, [table(headings, (one.cells() for one in found))])
