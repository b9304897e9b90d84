"""Rewards in PPO's size."""

from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn


class ScaledRewards(VecEnvWrapper):
    """Multiplies rewards by a constant; what `info["episode"]` tells stays in the paper's size."""

    def __init__(self, environment: VecEnv, scale: float) -> None:
        super().__init__(environment)
        self._scale = scale

    def reset(self) -> VecEnvObs:
        """Start all robots anew."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """One decision of every robot."""
        observations, rewards, dones, infos = self.venv.step_wait()
        return observations, rewards * self._scale, dones, infos
