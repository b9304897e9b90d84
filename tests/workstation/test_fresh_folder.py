from pathlib import Path

import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.fresh_folder import make_fresh

MARK, OTHERS = "run.log", ("pictures", "result.json")


def test_a_folder_is_made_or_emptied_where_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "out" / "demo"
    make_fresh(folder, MARK, OTHERS)
    monkeypatch.chdir(folder)
    for name in (MARK, "result.json", "pictures/1.png"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).touch()
    make_fresh(Path(), MARK, OTHERS)
    assert not list(folder.iterdir())
    assert Path.cwd() == folder


@pytest.mark.parametrize(
    ("there", "named"),
    [
        ((MARK, "result.json", "thesis.tex"), "thesis.tex"),
        (("result.json",), "result.json"),
        (("pictures", "a", "result.json"), "a"),
    ],
)
def test_what_is_anybody_elses_stays(tmp_path: Path, there: tuple[str, ...], named: str) -> None:
    for name in there:
        (tmp_path / name).write_text("years of work")
    with pytest.raises(ConfigurationError, match=f"holds other things, such as {named};"):
        make_fresh(tmp_path, MARK, OTHERS)
    assert {path.name for path in tmp_path.iterdir()} == set(there)


def test_a_link_is_taken_away_and_not_what_it_points_to(tmp_path: Path) -> None:
    photographs = tmp_path / "photographs"
    photographs.mkdir()
    (photographs / "1.jpg").touch()
    folder = tmp_path / "demo"
    folder.mkdir()
    (folder / MARK).touch()
    (folder / "pictures").symlink_to(photographs)
    make_fresh(folder, MARK, OTHERS)
    assert not list(folder.iterdir())
    assert (photographs / "1.jpg").exists()


def test_what_could_not_be_emptied_can_be_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in (MARK, "pictures"):
        (tmp_path / name).mkdir()

    def refuse(path: Path) -> None:
        if path.name != MARK:
            raise PermissionError(13, "Permission denied")
        path.rmdir()

    with monkeypatch.context() as patched:
        patched.setattr("shutil.rmtree", refuse)
        with pytest.raises(ConfigurationError, match="Permission denied"):
            make_fresh(tmp_path, MARK, OTHERS)
    make_fresh(tmp_path, MARK, OTHERS)
    assert not list(tmp_path.iterdir())


def test_a_file_in_the_way_is_named(tmp_path: Path) -> None:
    file = tmp_path / "demo"
    file.touch()
    with pytest.raises(ConfigurationError, match=f"can't make {file}"):
        make_fresh(file, MARK)
