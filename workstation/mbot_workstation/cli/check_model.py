"""`workstation check-model`: would a robot take this file, and if not, what is to be done?"""

from dataclasses import dataclass
from pathlib import Path

import typer

from mbot_workstation.cli.link_options import json_option
from mbot_workstation.cli.options import argument, with_options


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckModelOptions:
    """What `check_model_file` takes."""

    model: Path = argument("The policy to look at.", metavar="MODEL.onnx")
    as_json: bool = json_option()


@with_options
def check_model_file(options: CheckModelOptions) -> None:
    """Say all that is wrong with a policy, and how to mend it; no robot is needed.

    Size, versions, operators, metadata, inputs and outputs, golden frames, and the robot's own dry
    run. Exit code 0 if a robot takes it, 3 if none does.

    Example: `workstation check-model policy.onnx`
    """
    import json
    from dataclasses import asdict

    from mbot_protocol.errors import ContractError
    from mbot_workstation.fleet.models.model_findings import FAILED, examine_model
    from mbot_workstation.wording import typed

    findings = examine_model(options.model)
    failed = sum(finding.verdict == FAILED for finding in findings)
    if options.as_json:
        told = {"model": str(options.model), "accepted": not failed}
        print(json.dumps(told | {"findings": [asdict(finding) for finding in findings]}))
    else:
        for finding in findings:
            print(f"{finding.verdict:8} {finding.subject:8} {finding.detail}")
        print(
            f"{options.model}: {failed} to mend; docs/policy.md has the contract"
            if failed
            else f"{options.model}: a robot takes it; next: "
            f"workstation evaluate {typed(options.model)}"
        )
    if failed:
        raise typer.Exit(ContractError.exit_code)
