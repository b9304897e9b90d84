"""`workstation support`: one file for somebody who helps."""

from dataclasses import dataclass
from pathlib import Path

from mbot_workstation.cli.common_options import LinkOptions, json_option
from mbot_workstation.cli.options import check_new_file, option, output_file, with_options
from mbot_workstation.cli.presenter import Answer
from mbot_workstation.wording import typed


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
    files |= of_this_machine() | of_robot(options.link)
    write_archive(options.output, files)
    packed = Packed(options.output, sorted(files))
    look = f"tar -xzf {typed(options.output)} and look into {FOLDER} before you hand it on"
    return Answer(packed, [f"{options.output}: {', '.join(packed.files)}", f"next: {look}"])
