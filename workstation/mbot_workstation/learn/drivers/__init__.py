"""Who can drive in these worlds: ONNX policies, the task's expert, a random one."""
