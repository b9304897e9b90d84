import pickle

from mbot_protocol.errors import ConfigurationError, MbotError, RefusedError


def test_an_error_carries_its_kind_facts_and_remedy_beside_its_text() -> None:
    error = ConfigurationError("run 4 has a hole", kind="run-spoilt", remedy="leave it out", run=4)
    assert str(error) == "run 4 has a hole; leave it out"
    assert (error.kind, error.remedy, error.facts) == ("run-spoilt", "leave it out", {"run": 4})
    assert error.exit_code == 2


def test_an_error_of_text_alone_has_its_classes_kind() -> None:
    assert (MbotError("x").kind, RefusedError("x").kind) == ("failed", "refused")
    assert (RefusedError("x").facts, RefusedError("x").remedy) == ({}, "")


def test_what_an_error_carries_survives_a_file_s_name_and_another_process() -> None:
    error = RefusedError("no", kind="old-model", remedy="push again", age_s=3.0).within("a.onnx")
    again = pickle.loads(pickle.dumps(error))
    for one in (error, again):
        assert type(one) is RefusedError
        assert str(one) == "a.onnx: no; push again"
        assert (one.kind, one.remedy, one.facts) == ("old-model", "push again", {"age_s": 3.0})
