"""`workstation export`: a trained policy as a file for robots."""

from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.files import atomic_file
from mbot_workstation.cli.link_options import json_option
from mbot_workstation.cli.options import argument, option, output_file, with_options
from mbot_workstation.cli.output_paths import check_new_file


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportOptions:
    """What `export` takes."""

    source: Path = argument(
        "A run's folder, that of one checkpoint, or a policy that was exported before.",
        metavar="RUN",
    )
    output: Path | None = output_file(
        None, "A new file; RUN's name if not given.", "--output", "-o", metavar="FILE.onnx"
    )
    name: str | None = option(None, "What robots call it; the file's name if not given.")
    for_armv6: bool = option(
        False,
        "For a first Pi Zero, where OpenCV runs it: the same policy in an older dialect of ONNX.",
        "--for-armv6",
    )
    as_json: bool = json_option()


@with_options
def export(options: ExportOptions) -> None:
    """Write a trained policy as one ONNX file, ready for `workstation push-model`.

    The file says which run, code, lessons and rooms it comes from, and brings the frames of
    two drives with the actions they should give, so that anyone can check it.

    Examples:

    - `workstation export runs/first -o policy.onnx`
    - `workstation export runs/first/checkpoints/000400000 -o earlier.onnx`
    - `workstation export models/red-cube.onnx --for-armv6 -o red-cube-armv6.onnx`
    """
    import hashlib
    import json

    from mbot_workstation.learn.learning.policy_export import export_policy
    from mbot_workstation.learn.learning.trained_policy import trained_policy
    from mbot_workstation.wording import short_digest, size_words, typed

    if options.output is not None:
        check_new_file(options.output)  # before the work
    policy = trained_policy(options.source)
    path = options.output or Path(f"{policy.name}.onnx")
    check_new_file(path)
    policy_name = options.name or path.stem
    model = export_policy(policy, policy_name, for_armv6=options.for_armv6)
    data = model.SerializeToString(deterministic=True)
    atomic_file.save(path, data)
    sha256 = hashlib.sha256(data).hexdigest()
    if options.as_json:
        fields = {"path": str(path), "name": policy_name, "sha256": sha256}
        checkpoint = {"checkpoint": str(policy.checkpoint), "size_bytes": len(data)}
        print(json.dumps({**fields, **checkpoint}))
    else:
        print(
            f"wrote {path}: {policy_name} {short_digest(sha256)}, {size_words(len(data))}; "
            f"next: workstation evaluate {typed(path)}"
        )
