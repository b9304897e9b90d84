import pytest

from mbot_workstation.cli.transfer_bar import transfer_bar


def test_nothing_is_drawn_where_no_terminal_is(capsys: pytest.CaptureFixture[str]) -> None:
    with transfer_bar() as progress:
        task = progress.add_task("sending to mbot-1", total=100)
        progress.update(task, completed=100)
        assert progress.finished
    assert capsys.readouterr() == ("", "")
