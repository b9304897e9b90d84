"""The script of docs/policy.md makes what a robot takes."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np

from mbot_protocol.policy.dry_run import dry_run
from mbot_protocol.policy.policy import Policy
from mbot_workstation.fleet.models.check import check_model
from mbot_workstation.learn.drivers.onnx_policy import OnnxPolicy

PAGE = Path(__file__).parents[2] / "docs" / "policy.md"


def test_the_script_makes_a_policy_with_memory(tmp_path: Path) -> None:
    (script,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.S)
    subprocess.run([sys.executable, "-W", "ignore", "-c", script], cwd=tmp_path, check=True)
    path = tmp_path / "mine.onnx"
    assert check_model(path).metadata.contract_version == 2
    assert Policy.load(path).blank.state.shape == (1, 1, 32)
    driver = OnnxPolicy.load(path)  # one robot after the other: its batch is fixed
    pictures = np.random.default_rng(0).integers(0, 256, (3, 64, 64, 3)).astype(np.uint8)
    first, second = driver.act(pictures), driver.act(pictures)
    assert first.shape == (3, 2)
    assert (np.abs(first - second).max(axis=1) > 0).all(), "each of the three remembers"
    driver.forget(np.array([True, False, True]))
    third = driver.act(pictures)
    np.testing.assert_allclose(third[[0, 2]], first[[0, 2]], atol=1e-6)
    assert np.abs(third[1] - first[1]).max() > 0
    assert dry_run(path.read_bytes(), rate_hz=2.5).inference_ms < 200
