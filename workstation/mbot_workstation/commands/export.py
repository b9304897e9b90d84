"""`workstation export`: a trained policy as a file for robots."""

from pathlib import Path
from typing import Annotated

import typer

from mbot_workstation.commands.link_options import JsonOption


def export(
    *,
    source: Annotated[
        Path,
        typer.Argument(
            metavar="RUN",
            help="A run's folder, that of one checkpoint, or a policy that was exported before.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE.onnx", help="What to write; RUN's name if not given."
        ),
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="What robots call it; the file's name if not given.")
    ] = None,
    average: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="RUN",
            help="Average the weights with those of this run or policy, which began with RUN's "
            "weights or the other way round; may be given several times.",
        ),
    ] = None,
    turn: Annotated[
        float,
        typer.Option(
            min=0.3,
            max=2,
            metavar="SHARE",
            help="Turn by so much of what the policy says: 0.9 for a robot that turns too far "
            "before it sees, on a slippery floor or with late pictures.",
        ),
    ] = 1.0,
    as_json: JsonOption = False,
) -> None:
    """Write a trained policy as one ONNX file, ready for `workstation push-model`.

    The file says which run, code, lessons and rooms it comes from, and brings three frames with
    the actions they should give, so that anyone can check it.

    Examples:

    - `workstation export runs/first -o policy.onnx`
    - `workstation export policy.onnx --turn 0.9 -o calmer.onnx`
    """
    import hashlib
    import json

    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.training.learning.policy_export import export_policy
    from mbot_workstation.training.learning.trained_policy import averaged, trained_policy, turning
    from mbot_workstation.wording import short_digest, size_words

    found = trained_policy(source)
    path = output or Path(f"{found.name}.onnx")
    policy_name = name or path.stem
    policy = turning(averaged(found, [trained_policy(one) for one in average or ()]), turn)
    data = export_policy(policy, policy_name).SerializeToString(deterministic=True)
    try:
        path.write_bytes(data)
    except OSError as error:
        raise ConfigurationError(f"can't write {path}: {error.strerror}") from None
    sha256 = hashlib.sha256(data).hexdigest()
    if as_json:
        fields = {"path": str(path), "name": policy_name, "sha256": sha256}
        checkpoint = {"checkpoint": str(found.checkpoint), "size_bytes": len(data)}
        print(json.dumps({**fields, **checkpoint}))
    else:
        print(
            f"wrote {path}: {policy_name} {short_digest(sha256)}, {size_words(len(data))}; "
            f"next: workstation evaluate {path}"
        )
