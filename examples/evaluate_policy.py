"""Episodes of a policy in the simulation. `evaluate_policy.py MODEL.onnx` tries yours."""

import sys
from pathlib import Path

from mbot.sim import make_env
from mbot_workstation.learn.drivers.onnx_policy import OnnxPolicy

SHIPPED = Path(__file__).parents[1] / "models" / "red-cube.onnx"

policy = OnnxPolicy.load(Path(*sys.argv[1:]) if sys.argv[1:] else SHIPPED)
env = make_env(preset="nominal", seed=1)
rewards = []
for episode in range(3):
    picture, facts = env.reset()
    policy.forget()  # what it remembers is of one episode
    rewards.append(0.0)
    ended = False
    while not ended:
        picture, reward, ended, _, facts = env.step(policy.act(picture[None])[0])
        rewards[-1] += float(reward)
    print(f"episode {episode}: reward {rewards[-1]:.2f}, {facts['touches']} of 10 touched")
print(f"{policy.metadata.name}: mean reward {sum(rewards) / len(rewards):.2f} of 21")
env.close()
