"""The policy that needs no training: drive at the red cube, or turn on the spot to find it.

It follows the policy contract like any learned model, so it is the first thing to push to a robot
and the baseline a learned policy has to beat. One ONNX graph of standard operators, stateless:

    observation -> redness of every pixel -> evidence of every column -> bearing -> two wheels

Signs: bearings are positive to the right of the optical axis; a positive turn drives the left
wheel faster, which turns the robot clockwise seen from above.
"""

from dataclasses import dataclass

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.policy.policy_contract import (
    ACTION_SHAPE,
    INPUT_NAME,
    OBSERVATION_SHAPE,
    OBSERVATION_SIDE_PX,
    OUTPUT_NAME,
    FieldOfView,
    PolicyMetadata,
)

OPSET = 13
"""ReduceSum took its axes as an input from here on; every onnxruntime since 1.5 runs it."""
IR_VERSION = 8
"""Old enough for onnxruntime 1.10; `onnx.helper` would write the newest, which robots refuse."""

CAMERA_PITCH_DEG = 5.0
"""How far the camera looks down (nominal mount)."""


@dataclass(frozen=True, slots=True)
class ServoGains:
    """Every number of the servo. The defaults are for the nominal robot and 2.5 decisions a second.

    The driving gains were found by measurement: the most objects fetched by simulated robots with
    motors of 50 to 105 % strength, dead bands of 40 to 60, wheels that lag 60 to 120 ms and
    cameras that lag 40 to 80 ms. They form a plateau; 20 % up or down costs little.

    Attributes:
        search_speed: wheel speed of the search turn, share of full speed. 0.25 turns by 28 to
            40 degrees a decision, depending on the dead band: less than the view is wide, and
            slow enough that blur leaves something of a cube at 5 m.
        right_turn: half the difference of the wheel speeds per radian of bearing, for an object
            on the right. At 2.5 decisions a second 0.35 would turn exactly by the bearing. It is
            less because the search turn, also to the right, still runs on for 10 to 20 degrees
            after the picture that ended it.
        left_turn: likewise on the left. It is more because what gets lost on the left costs a
            whole search turn; what gets lost on the right comes back at once.
        straight_deg: full speed ahead for bearings up to this.
        slow_deg: from there the speed falls linearly, down to `slowest` at this bearing: the edge
            of the view.
        slowest: share of full speed; keeps wheels beyond their dead band.
        dark: added to the brightness, of 255, that redness is relative to; noise decides the
            colour of anything darker.
        orange_penalty: how much green above blue counts against redness: brown, wood, skin.
        tint_limit: the floor's mean redness, up to this, is put down to its own colour or the
            light and does not count. The cube has 0.75, so a view full of it still does.
        redness_threshold: redness, above the tint, from which a pixel counts.
        gate_open_deg, gate_closed_deg: elevations above the horizon. Pixels count fully below the
            first and not at all above the second. The cube reaches at most 0.3 degrees above it
            beyond 5 m, the 20 cm walls at least 1.1 degrees; a mount is 1.5 degrees off at worst.
        focus: power of a column's evidence that weighs its bearing; more lets the best column win.
        evidence_low, evidence_high: sums of redness in the best column below which there is no
            object, and above which there surely is one. Without a red thing in view 98 % of
            simulated pictures gave less than 0.01 and all at most 0.10; a cube at 4 to 5 m gave
            at least 0.13.

    """

    search_speed: float = 0.25
    right_turn: float = 0.30
    left_turn: float = 0.75
    straight_deg: float = 3.0
    slow_deg: float = 27.0
    slowest: float = 0.1
    dark: float = 20.0
    orange_penalty: float = 1.0
    tint_limit: float = 0.4
    redness_threshold: float = 0.1
    gate_open_deg: float = 0.3
    gate_closed_deg: float = 1.8
    focus: float = 3.0
    evidence_low: float = 0.07
    evidence_high: float = 0.13


class _Graph:
    """Nodes and constants of a graph in the making; every call returns its output's name."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def constant(self, value: object, kind: type = np.float32) -> str:
        name = f"constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.asarray(value, dtype=kind), name))
        return name

    def add(
        self, kind: str, *inputs: str, output: str | None = None, **attributes: int | list[int]
    ) -> str:
        name = output or f"{kind.lower()}_{len(self.nodes)}"
        node = helper.make_node(kind, list(inputs), [name], name=name)
        node.attribute.extend(helper.make_attribute(key, attributes[key]) for key in attributes)
        self.nodes.append(node)
        return name


def column_bearings(view: FieldOfView) -> NDArray[np.float64]:
    """Bearing of every observation column, positive to the right. Shape (64,), degrees."""
    camera = _camera(view)
    columns = np.arange(OBSERVATION_SIDE_PX)
    return np.degrees(np.arctan((columns - camera.principal_x_px) / camera.focal_x_px))


def row_elevations(view: FieldOfView) -> NDArray[np.float64]:
    """Elevation of every row above the horizon of a nominal mount. Shape (64,), degrees."""
    camera = _camera(view)
    rows = np.arange(OBSERVATION_SIDE_PX)
    return -CAMERA_PITCH_DEG - np.degrees(
        np.arctan((rows - camera.principal_y_px) / camera.focal_y_px)
    )


def _camera(view: FieldOfView) -> CameraModel:
    return CameraModel.from_field_of_view(
        OBSERVATION_SIDE_PX, OBSERVATION_SIDE_PX, view.horizontal_deg, view.vertical_deg
    )


def servo_model(gains: ServoGains, metadata: PolicyMetadata) -> onnx.ModelProto:
    """Build the servo for one field of view.

    Returns:
        A model that follows the policy contract: standard operators, no external data.

    """
    graph = _Graph()
    evidence = _column_evidence(graph, gains, metadata.view)
    bearing, seen = _bearing(graph, gains, metadata.view, evidence)
    _wheels(graph, gains, bearing, seen)
    model = helper.make_model(
        helper.make_graph(
            graph.nodes,
            "visual_servo",
            [helper.make_tensor_value_info(INPUT_NAME, TensorProto.UINT8, OBSERVATION_SHAPE)],
            [helper.make_tensor_value_info(OUTPUT_NAME, TensorProto.FLOAT, ACTION_SHAPE)],
            graph.constants,
        ),
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="mbot-agent",
    )
    helper.set_model_props(model, metadata.to_properties())
    onnx.checker.check_model(model, full_check=True)
    return model


def _column_evidence(graph: _Graph, gains: ServoGains, view: FieldOfView) -> str:
    """How much red every column holds at and below the horizon. Shape (1, 64)."""
    # A 3 x 3 binomial blur first: it is as wide as the cube at 2.5 m, and evens out the noise that
    # would make dark pixels look coloured.
    weights = np.outer([1, 2, 1], [1, 2, 1]) / 16
    picture = graph.add("Cast", INPUT_NAME, to=TensorProto.FLOAT)
    picture = graph.add("Transpose", picture, perm=[0, 3, 1, 2])
    picture = graph.add(
        "Conv", picture, graph.constant(np.tile(weights, (3, 1, 1, 1))), group=3, pads=[1, 1, 1, 1]
    )
    red, green, blue = (
        graph.add("Gather", picture, graph.constant(channel, np.int64), axis=1)
        for channel in range(3)
    )
    # Relative to the pixel's own brightness, so that exposure and shading cancel. Brown, wood and
    # skin have more green than blue; a red object has about as much of both.
    excess = graph.add("Sub", red, graph.add("Max", green, blue))
    orange = graph.add("Abs", graph.add("Sub", green, blue))
    orange = graph.add("Mul", orange, graph.constant(gains.orange_penalty))
    redness = graph.add(
        "Div",
        graph.add("Sub", excess, orange),
        graph.add("Add", red, graph.constant(gains.dark)),
    )
    elevations = row_elevations(view)
    gate = np.interp(elevations, [gains.gate_open_deg, gains.gate_closed_deg], [1.0, 0.0])
    # What the whole floor shows of red is its own colour, the light's tint or a dark room's noise.
    floor = graph.add(
        "Mul",
        _clip(graph, redness, 0.0, gains.tint_limit),
        graph.constant((gate / gate.sum() / OBSERVATION_SIDE_PX).reshape(1, -1, 1)),
    )
    tint = graph.add("ReduceSum", floor, graph.constant([1, 2], np.int64), keepdims=1)
    above = graph.add(
        "Sub", graph.add("Sub", redness, tint), graph.constant(gains.redness_threshold)
    )
    gated = graph.add("Mul", graph.add("Relu", above), graph.constant(gate.reshape(1, -1, 1)))
    return graph.add("ReduceSum", gated, graph.constant([1], np.int64), keepdims=0)


def _bearing(graph: _Graph, gains: ServoGains, view: FieldOfView, evidence: str) -> tuple[str, str]:
    """Bearing of the object in degrees and whether there is one, 0 to 1. Shapes (1, 1)."""
    peak = graph.add("ReduceMax", evidence, axes=[1], keepdims=1)
    # Weights relative to the best column, to a power: the one object outweighs scattered clutter.
    share = graph.add("Div", evidence, graph.add("Add", peak, graph.constant(1e-6)))
    weight = graph.add("Pow", share, graph.constant(gains.focus))
    moment = graph.add("Mul", weight, graph.constant(column_bearings(view).reshape(1, -1)))
    axes = graph.constant([1], np.int64)
    bearing = graph.add(
        "Div",
        graph.add("ReduceSum", moment, axes, keepdims=1),
        graph.add("Add", graph.add("ReduceSum", weight, axes, keepdims=1), graph.constant(1e-6)),
    )
    span = gains.evidence_high - gains.evidence_low
    seen = _clip(
        graph,
        graph.add(
            "Div",
            graph.add("Sub", peak, graph.constant(gains.evidence_low)),
            graph.constant(span),
        ),
        0.0,
        1.0,
    )
    return bearing, seen


def _wheels(graph: _Graph, gains: ServoGains, bearing: str, seen: str) -> None:
    """Both wheels: drive at the bearing as far as the object is seen, search for the rest."""
    right = graph.add("Relu", bearing)
    left = graph.add("Relu", graph.add("Neg", bearing))
    turn = graph.add(
        "Sub",
        graph.add("Mul", right, graph.constant(np.radians(gains.right_turn))),
        graph.add("Mul", left, graph.constant(np.radians(gains.left_turn))),
    )
    slope = (1.0 - gains.slowest) / (gains.slow_deg - gains.straight_deg)
    beyond = graph.add("Sub", graph.add("Abs", bearing), graph.constant(gains.straight_deg))
    speed = graph.add("Sub", graph.constant(1.0), graph.add("Mul", beyond, graph.constant(slope)))
    speed = _clip(graph, speed, gains.slowest, 1.0)
    # Never ask for more than full speed: clipping one wheel would halve the turn.
    room = graph.add("Sub", graph.constant(1.0), graph.add("Abs", turn))
    speed = graph.add("Min", speed, room)
    drive = graph.add(
        "Concat", graph.add("Add", speed, turn), graph.add("Sub", speed, turn), axis=1
    )
    search = graph.constant([[gains.search_speed, -gains.search_speed]])
    change = graph.add("Mul", graph.add("Sub", drive, search), seen)
    _clip(graph, graph.add("Add", change, search), -1.0, 1.0, output=OUTPUT_NAME)


def _clip(graph: _Graph, value: str, low: float, high: float, output: str | None = None) -> str:
    return graph.add("Clip", value, graph.constant(low), graph.constant(high), output=output)
