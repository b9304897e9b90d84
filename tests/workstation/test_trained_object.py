import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.policy_contract import PolicyMetadata
from mbot_workstation.cli import demo
from mbot_workstation.cli import evaluate as evaluate_command
from mbot_workstation.cli.demo import DemoOptions
from mbot_workstation.cli.evaluate import evaluate, study
from mbot_workstation.cli.models import check_model_file
from mbot_workstation.fleet.models.model_findings import PROVENANCE
from mbot_workstation.fleet.models.trained_object import (
    TrainedObject,
    objects_of,
    told_object,
    trained_object,
)
from mbot_workstation.learn.evaluation.episodes import EpisodeResult, Trial, score
from mbot_workstation.learn.evaluation.evaluation_report import Line
from mbot_workstation.learn.evaluation.objects_tried import object_table, objects_tried
from mbot_workstation.learn.learning.checkpoint import CheckpointState, RandomState
from mbot_workstation.learn.learning.curriculum import CurriculumState
from mbot_workstation.learn.learning.policy_source import Source
from mbot_workstation.learn.learning.run_directory import write_json
from mbot_workstation.learn.learning.trained_policy import provenance
from mbot_workstation.learn.learning.training_config import TrainingConfig
from mbot_workstation.learn.learning.training_run import begin_run
from mbot_workstation.sim.scene.object_file import read_objects
from mbot_workstation.sim.scene.target_object import RED_CUBE
from mbot_workstation.tasks.fetch.task import TASK

from .called import output_of
from .glb_samples import Part, write_glb
from .samples import small_policy

OBJECTS = Path(__file__).parents[2] / "models" / "objects"
BALL, BOTTLE = OBJECTS / "green-ball.toml", OBJECTS / "blue-bottle.toml"


def policy(path: Path, origin: Mapping[str, Any] | str | None = None) -> str:
    """A policy's file, by its path; of such provenance."""
    told = origin if isinstance(origin, str) else json.dumps(origin)
    also = {} if origin is None else {PROVENANCE: told}
    model = small_policy(properties=PolicyMetadata("new").to_properties() | also)
    path.write_bytes(model.SerializeToString())
    return str(path)


def of(path: Path) -> dict[str, Any]:
    return {"object": msgspec.to_builtins(told_object(path))}


def test_a_policy_says_what_its_run_learned_to_fetch_unless_it_is_the_red_cube(
    tmp_path: Path,
) -> None:
    config = TrainingConfig(made_up_rooms=1, object_file=str(BOTTLE))
    run = begin_run(tmp_path / "run", config)
    write_json(run.git_file, [{"from_step": 0, "commit": "c" * 40, "changed_files": []}])
    state = CheckpointState(0, 0.0, CurriculumState(), RandomState.now(), None)
    made = provenance(Source(run, tmp_path), config, state)
    thing = trained_object(Path(policy(tmp_path / "bottle.onnx", made)))
    assert thing == told_object(BOTTLE)
    assert thing is not None
    assert (thing.words, thing.option) == ("blue bottle", " --object blue-bottle.toml")
    assert str(OBJECTS) not in json.dumps(made)
    for file in ("", str(OBJECTS / "red-cube.toml")):
        cube = provenance(Source(run, tmp_path), replace(config, object_file=file), state)
        assert "object" not in cube


def test_what_has_no_files_is_built_from_the_policy_alone(tmp_path: Path) -> None:
    thing = trained_object(Path(policy(tmp_path / "ball.onnx", of(BALL))))
    assert thing is not None
    assert thing.objects() == read_objects(BALL)
    bottle = told_object(BOTTLE)
    assert bottle is not None
    with pytest.raises(ConfigurationError, match=r"blue-bottle\.toml by --object"):
        bottle.objects()
    with pytest.raises(ConfigurationError, match="what can't be"):
        replace_kind(of(BALL), tmp_path, width_mm=5000).objects()


def replace_kind(origin: dict[str, Any], folder: Path, **changed: Any) -> Any:
    origin["object"]["kinds"][0].update(changed)
    return trained_object(Path(policy(folder / "changed.onnx", origin)))


def test_what_means_the_same_has_the_same_digest(tmp_path: Path) -> None:
    ball, again = told_object(BALL), tmp_path / "again.toml"
    again.write_text(BALL.read_text().replace("#1e", "#1E").replace("100", "100.0") + "# seen\n")
    same = told_object(again)
    assert ball is not None
    assert same is not None
    assert same.sha256 == ball.sha256
    (tmp_path / BOTTLE.name).write_text(BOTTLE.read_text())
    write_glb(tmp_path / "blue-bottle.glb", [Part(high=2.0)])
    other, bottle = told_object(tmp_path / BOTTLE.name), told_object(BOTTLE)
    assert other is not None
    assert bottle is not None
    assert other.sha256 != bottle.sha256


def test_old_policies_and_those_of_others_fetch_the_red_cube(tmp_path: Path) -> None:
    for origin in (None, {"run": "first"}, "made by hand"):
        assert trained_object(Path(policy(tmp_path / "old.onnx", origin))) is None
    with pytest.raises(ConfigurationError, match="export it again"):
        trained_object(Path(policy(tmp_path / "odd.onnx", {"object": "a mug"})))


def test_policies_are_tried_on_what_they_were_trained_for(tmp_path: Path) -> None:
    old, ball = policy(tmp_path / "old.onnx"), policy(tmp_path / "ball.onnx", of(BALL))
    (tried,), notes = objects_tried({"servo": "servo", ball: "ball"}, [])
    assert tried.kinds == read_objects(BALL)
    assert notes == ["without --object it is the green ball, which ball was trained for"]
    (tried,), notes = objects_tried({"servo": "servo", old: "old"}, [])
    assert (tried.kinds, notes) == ((RED_CUBE,), [])
    with pytest.raises(ConfigurationError, match="old for the red cube, ball for the green ball"):
        objects_tried({old: "old", ball: "ball"}, [])


def test_another_object_than_it_was_trained_for_is_said(tmp_path: Path) -> None:
    old, ball = policy(tmp_path / "old.onnx"), policy(tmp_path / "ball.onnx", of(BALL))
    both = {old: "old", ball: "ball"}
    (tried,), notes = objects_tried(both, [BALL])
    assert tried.name == "green ball"
    assert notes == ["old was trained for the red cube, and is tried on the green ball"]
    tried, notes = objects_tried(both, [BALL, OBJECTS / "red-cube.toml"])
    assert [one.name for one in tried] == ["green ball", "red cube"]
    assert notes == []


def test_several_objects_make_a_table(tmp_path: Path) -> None:
    two = ("--object", BALL, "--object", BOTTLE)
    with pytest.raises(ConfigurationError, match="give one --object"):
        output_of(evaluate, "servo", *two, "--film", tmp_path / "film.mp4")
    ten = score([EpisodeResult(20.0, 150, 10, completed=True)])
    tried = [(name, [Line("servo", "nominal", ten)]) for name in ("green ball", "mug")]
    table = object_table(tried, "one", TASK)
    assert [column.header for column in table.columns][2:] == ["green ball", "mug"]
    assert list(table.columns[3].cells) == ["10.00 (10.00-10.00)"]


def test_a_check_names_the_object_and_what_evaluate_has_to_be_told(tmp_path: Path) -> None:
    ball = output_of(check_model_file, policy(tmp_path / "ball.onnx", of(BALL)))
    assert "trained for the green ball; next: workstation evaluate" in ball
    assert "--object" not in ball
    bottle = output_of(check_model_file, policy(tmp_path / "bottle.onnx", of(BOTTLE)))
    assert bottle.endswith(" --object blue-bottle.toml\n")


@pytest.mark.slow
def test_a_policy_for_the_ball_meets_balls_without_a_word(tmp_path: Path) -> None:
    ball = policy(tmp_path / "ball.onnx", of(BALL))
    options = ("--lesson", "1", "--episodes", "1", "--made-up-rooms", "1", "--workers", "1")
    told = output_of(evaluate, ball, *options, "--json")
    (line,) = json.loads(told[told.index("[") :])
    assert line["object"] == "green ball"


def test_a_policy_stands_for_what_it_fetches_wherever_an_object_is_asked_for(
    tmp_path: Path,
) -> None:
    ball, plain = (
        Path(policy(tmp_path / name, of(BALL) if own else None))
        for name, own in (("ball.onnx", True), ("plain.onnx", False))
    )
    assert objects_of(ball) == objects_of(BALL) == read_objects(BALL)
    assert objects_of(plain) == objects_of(None) == (RED_CUBE,)
    told = demo._robot_options(DemoOptions(model=ball))  # pyright: ignore[reportPrivateUsage]
    assert told[told.index("--object") + 1] == str(ball)
    other = demo._robot_options(DemoOptions(model=ball, object=BOTTLE))  # pyright: ignore[reportPrivateUsage]
    assert other[other.index("--object") + 1] == str(BOTTLE)
    assert "--object" not in demo._robot_options(DemoOptions(model=plain))  # pyright: ignore[reportPrivateUsage]


def test_a_study_is_of_what_its_policies_fetch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Trial] = []

    def runner(_options: object, trial: Trial) -> object:
        seen.append(trial)
        raise ConfigurationError("enough")

    monkeypatch.setattr(evaluate_command, "_runner", runner)
    ball = policy(tmp_path / "ball.onnx", of(BALL))
    for options in ([ball], [ball, "--object", str(BOTTLE)]):
        with pytest.raises(ConfigurationError, match="enough"):
            output_of(study, "robots", *options)
    assert [one.scene.objects for one in seen] == [read_objects(BALL), read_objects(BOTTLE)]


def test_a_strangers_file_name_is_a_name_and_can_be_pasted() -> None:
    evil = TrainedObject("../up\x1b[31m; rm -rf x.toml", "", ({"name": "x", "mesh": "x.glb"},))
    assert evil.option == " --object 'up [31m; rm -rf x.toml'"
    with pytest.raises(ConfigurationError) as refused:
        evil.objects()
    assert "\x1b" not in str(refused.value)
    assert ".." not in str(refused.value)
