"""`workstation make-servo-policy`: a policy without training, to push first and compare with."""

from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.files import atomic_file
from mbot_protocol.policy.policy_contract import FULL_VIEW, FieldOfView, PolicyMetadata
from mbot_workstation.cli.link_options import json_option
from mbot_workstation.cli.options import argument, option, with_options

POLICY_NAME = "servo"


@dataclass(frozen=True, slots=True, kw_only=True)
class MakeServoPolicyOptions:
    """What `make_servo_policy` takes."""

    output: Path = argument("The ONNX file to write.", default=Path("servo.onnx"))
    search_speed: float | None = option(
        None,
        "Wheel speed of the search turn, share of full speed; 0.25 if not given. Less if "
        "the robot spins past the cube, more if it hardly turns.",
        min=0.05,
        max=1.0,
    )
    view: tuple[float, float] = option(
        (FULL_VIEW.horizontal_deg, FULL_VIEW.vertical_deg),
        "Field of view of the observation, degrees.",
        metavar="WIDTH HEIGHT",
    )
    as_json: bool = json_option()


@with_options
def make_servo_policy(options: MakeServoPolicyOptions) -> None:
    """Write a policy that needs no training: it drives at the red cube, or turns to find it.

    Robots take it as they take a trained model, and a trained model has to beat it. The same
    options give the same file.

    Example: `workstation make-servo-policy servo.onnx`, then `workstation push-model servo.onnx`
    """
    import hashlib
    import json
    from dataclasses import replace

    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.fleet.models.servo_policy import ServoGains, servo_model
    from mbot_workstation.wording import short_digest, typed

    try:
        metadata = PolicyMetadata(POLICY_NAME, FieldOfView(*options.view))
    except ValueError as error:
        raise ConfigurationError(f"--view: {error}") from None
    gains = ServoGains()
    if options.search_speed is not None:
        gains = replace(gains, search_speed=options.search_speed)
    data = servo_model(gains, metadata).SerializeToString(deterministic=True)
    atomic_file.save(options.output, data)
    sha256 = hashlib.sha256(data).hexdigest()
    if options.as_json:
        fields = {"path": str(options.output), "name": POLICY_NAME, "sha256": sha256}
        print(json.dumps({**fields, "size_bytes": len(data)}))
    else:
        print(
            f"wrote {options.output}: {POLICY_NAME} {short_digest(sha256)}, "
            f"{len(data) / 1e3:.1f} kB; next: workstation push-model {typed(options.output)}"
        )
