"""Small things that the workstation's tests send around: a policy, decisions, a picture."""

import cv2
import numpy as np
import onnx
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from onnx import TensorProto, helper

from mbot_protocol.policy.policy_contract import PolicyMetadata
from mbot_protocol.v1.messages_pb2 import Decision, State, Steps, Wheels

SECOND_NS = 1_000_000_000
START_UNIX_NS = 1_700_000_000 * SECOND_NS


def small_policy(
    *,
    weights_bytes: int = 0,
    properties: dict[str, str] | None = None,
    input_type: int = TensorProto.UINT8,
    input_shape: tuple[int | str, ...] = ("batch", 64, 64, 3),
    output_shape: tuple[int | str, ...] = ("batch", 2),
    outputs: int = 1,
) -> onnx.ModelProto:
    """The mean of the picture's red and green, by default a policy that follows the contract."""
    nodes = [
        helper.make_node("Cast", ["observation"], ["float"], to=TensorProto.FLOAT),
        helper.make_node("ReduceMean", ["float"], ["colour"], axes=[1, 2], keepdims=0),
        helper.make_node("Slice", ["colour", "from", "to", "axis"], ["action"]),
    ]
    constants = [
        helper.make_tensor("from", TensorProto.INT64, [1], [0]),
        helper.make_tensor("to", TensorProto.INT64, [1], [2]),
        helper.make_tensor("axis", TensorProto.INT64, [1], [1]),
        helper.make_tensor(
            "ballast", TensorProto.UINT8, [weights_bytes], bytes(weights_bytes), raw=True
        ),
    ]
    found = [helper.make_tensor_value_info("action", TensorProto.FLOAT, output_shape)]
    if outputs == 2:
        found.append(helper.make_tensor_value_info("colour", TensorProto.FLOAT, ("batch", 3)))
    graph = helper.make_graph(
        nodes,
        "policy",
        [helper.make_tensor_value_info("observation", input_type, input_shape)],
        found,
        constants,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    if properties is None:
        properties = PolicyMetadata("new").to_properties()
    helper.set_model_props(model, properties)
    return model


def decision(sequence: int = 0, session_id: int = 1) -> Decision:
    """A decision of a robot that drives, its stages 10 ms apart."""
    started_ns = 100 * SECOND_NS + sequence * SECOND_NS // 10
    return Decision(
        schema_version=1,
        robot_id="mbot-1",
        session_id=session_id,
        sequence=sequence,
        state=State.STATE_RUNNING,
        unix_time_ns=START_UNIX_NS + sequence * SECOND_NS // 10,
        captured_monotonic_ns=started_ns - 30_000_000,
        due_monotonic_ns=started_ns - 1_000_000,
        started_monotonic_ns=started_ns,
        observed_monotonic_ns=started_ns + 10_000_000,
        decided_monotonic_ns=started_ns + 20_000_000,
        written_monotonic_ns=started_ns + 30_000_000,
        acknowledged_monotonic_ns=started_ns + 40_000_000,
        action=Wheels(left=0.5, right=-0.25),
        steps=Steps(left=125, right=-62),
        board_m1=-147,
        board_m2=-93,
        model_sha256="a" * 64,
        missed_ticks=3,
        cpu_temperature_c=51.5,
        load_1min=0.75,
        resident_memory_bytes=200 * 2**20,
        dropped_records=2,
    )


def picture(unix_time_ns: int = START_UNIX_NS) -> CompressedImage:
    """A 64 x 64 PNG, red above, blue below."""
    pixels = np.zeros((64, 64, 3), np.uint8)
    pixels[:32, :, 2] = 255  # OpenCV encodes BGR
    pixels[32:, :, 0] = 255
    done, data = cv2.imencode(".png", pixels)
    assert done
    image = CompressedImage(frame_id="camera", format="png", data=data.tobytes())
    image.timestamp.FromNanoseconds(unix_time_ns)
    return image
