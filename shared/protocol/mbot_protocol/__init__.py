"""What the robot and the workstation must agree on: keys, messages, policy contract, pipelines."""
