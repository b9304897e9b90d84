"""PPO through the lessons: network, learner, callback, checkpoints, export."""
