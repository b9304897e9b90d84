"""`workstation make-servo-policy`: a policy without training, to push first and compare with."""

from pathlib import Path
from typing import Annotated

import typer

from mbot_protocol.policy_contract import FULL_VIEW, FieldOfView, PolicyMetadata
from mbot_workstation.commands.link_options import JsonOption

POLICY_NAME = "servo"


def make_servo_policy(
    output: Annotated[Path, typer.Argument(help="The ONNX file to write.")] = Path("servo.onnx"),
    *,
    search_speed: Annotated[
        float | None,
        typer.Option(
            min=0.05,
            max=1.0,
            help="Wheel speed of the search turn, share of full speed; 0.25 if not given. Less if "
            "the robot spins past the cube, more if it hardly turns.",
        ),
    ] = None,
    view: Annotated[
        tuple[float, float],
        typer.Option(metavar="WIDTH HEIGHT", help="Field of view of the observation, degrees."),
    ] = (FULL_VIEW.horizontal_deg, FULL_VIEW.vertical_deg),
    as_json: JsonOption = False,
) -> None:
    """Write a policy that needs no training: it drives at the red cube, or turns to find it.

    Robots take it as they take a trained model, and a trained model has to beat it. The same
    options give the same file.

    Example: `workstation make-servo-policy servo.onnx`, then `workstation push-model servo.onnx`
    """
    import hashlib
    import json
    from dataclasses import replace

    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.models.servo_policy import ServoGains, servo_model
    from mbot_workstation.wording import short_digest

    try:
        metadata = PolicyMetadata(POLICY_NAME, FieldOfView(*view))
    except ValueError as error:
        raise ConfigurationError(f"--view: {error}") from None
    gains = ServoGains()
    if search_speed is not None:
        gains = replace(gains, search_speed=search_speed)
    data = servo_model(gains, metadata).SerializeToString(deterministic=True)
    try:
        output.write_bytes(data)
    except OSError as error:
        raise ConfigurationError(f"can't write {output}: {error.strerror}") from None
    sha256 = hashlib.sha256(data).hexdigest()
    if as_json:
        fields = {"path": str(output), "name": POLICY_NAME, "sha256": sha256}
        print(json.dumps({**fields, "size_bytes": len(data)}))
    else:
        print(
            f"wrote {output}: {POLICY_NAME} {short_digest(sha256)}, {len(data) / 1e3:.1f} kB; "
            f"next: workstation push-model {output}"
        )
