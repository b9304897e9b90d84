"""A policy of a few lines of numpy, tried in the simulation: where is it red, and how red?"""

import numpy as np

from mbot.sim import make_env


def policy(picture: np.ndarray) -> np.ndarray:
    """Wheels from what it sees, shape (64, 64, 3)."""
    red, green, blue = picture[24:].astype(float).transpose(2, 0, 1)  # below the horizon
    redness = (red - np.maximum(green, blue) - abs(green - blue)) / (red + 20)
    columns = np.clip(redness - 0.2, 0, None).sum(axis=0)
    if columns.max() < 0.1:
        return np.array([0.25, -0.25], np.float32)  # turn to the right until there is some
    aside = np.average(np.linspace(-1, 1, 64), weights=columns**3)
    turn = aside * (0.15 if aside > 0 else 0.3)  # the search turn runs on: it is on the left then
    return np.array([0.9 - 0.7 * abs(aside) + turn, 0.9 - 0.7 * abs(aside) - turn], np.float32)


env = make_env(seed=1)
for episode in range(3):
    picture, facts = env.reset()
    total, ended = 0.0, False
    while not ended:
        picture, reward, ended, _, facts = env.step(policy(picture))
        total += float(reward)
    print(f"episode {episode}: reward {total:.2f}, {facts['touches']} of 10 touched")
env.close()
