import pytest

from mbot_agent.process.one_line_parser import OneLineParser


def parser() -> OneLineParser:
    made = OneLineParser(prog="agent", description="", epilog="")
    made.add_argument("action", nargs="?", choices=("run", "check"))
    made.add_argument("--config")
    return made


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["chek"], "; did you mean check? see `agent --help`"),
        (["run", "--confg=x"], "unrecognized arguments: --confg=x; did you mean --config?"),
        (["run", "--conf", "run"], "unrecognized arguments"),  # nothing is guessed
        (["--config"], "argument --config: expected one argument; see `agent --help`"),
    ],
)
def test_a_mistake_is_one_line(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        parser().parse_args(words)
    errors = capsys.readouterr().err
    assert ended.value.code == 2
    assert errors.startswith("agent: ")
    assert said in errors
    assert errors.count("\n") == 1


def test_good_words_pass() -> None:
    assert parser().parse_args(["check", "--config", "x"]).config == "x"
