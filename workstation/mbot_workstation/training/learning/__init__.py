"""PPO through the lessons: network, learner, teacher, checkpoints, export."""
