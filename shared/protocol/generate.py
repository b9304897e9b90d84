"""Generate the Python code of the messages: `make protocol`. A test checks that it is current."""

# pyright: basic, reportMissingTypeStubs=false

import re
import sys
from pathlib import Path

from grpc_tools import protoc

HERE = Path(__file__).parent
PROTOS = ("mbot_protocol/v1/messages.proto", "mbot_protocol/v1/recordings.proto")


def generate(target: Path) -> None:
    """Write the _pb2.py and _pb2.pyi of each .proto file under `target`/mbot_protocol/v1.

    Raises:
        RuntimeError: protoc refused a .proto file; it has printed why.

    """
    target.mkdir(parents=True, exist_ok=True)
    arguments = ["protoc", f"-I{HERE}", f"--python_out={target}", f"--pyi_out={target}", *PROTOS]
    if protoc.main(arguments) != 0:
        raise RuntimeError(f"protoc refused one of {', '.join(PROTOS)}")
    for proto in PROTOS:
        # protoc leaves Mapping without type arguments, which strict type checking refuses.
        stub = target / proto.replace(".proto", "_pb2.pyi")
        stub.write_text(re.sub(r"_Mapping\]", "_Mapping[str, object]]", stub.read_text()))


if __name__ == "__main__":
    generate(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
