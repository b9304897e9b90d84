"""Who can drive in these worlds: ONNX policies, the oracle, the guide, a random one."""
