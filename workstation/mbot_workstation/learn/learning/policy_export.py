"""A trained network becomes a policy file: graph, where it comes from, frames to check it by."""

import json

import onnx

from mbot_protocol.policy.golden_frames import PROPERTY
from mbot_protocol.policy.policy_contract import FULL_VIEW, PolicyMetadata
from mbot_workstation.learn.learning.golden_answers import golden_property
from mbot_workstation.learn.learning.policy_graph import policy_graph
from mbot_workstation.learn.learning.trained_policy import PROVENANCE, TrainedPolicy
from mbot_workstation.learn.worlds.example_frames import golden_sequence


def export_policy(policy: TrainedPolicy, name: str, *, for_armv6: bool = False) -> onnx.ModelProto:
    """Build the policy file's content.

    The same weights give the same model, on machines that render alike.

    Args:
        policy: what to export.
        name: what robots call it.
        for_armv6: see `policy_graph`.

    Raises:
        ConfigurationError: nothing can be rendered here.

    """
    origin = json.dumps(policy.provenance, separators=(",", ":"))
    metadata = PolicyMetadata(name, FULL_VIEW)
    model = policy_graph(policy.weights, metadata, {PROVENANCE: origin}, for_armv6=for_armv6)
    golden = model.metadata_props.add()
    golden.key, golden.value = PROPERTY, golden_property(model, golden_sequence())
    return model
