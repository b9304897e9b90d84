from mbot_workstation.measure.identification.left_out import grouped

LATE = "its track does not begin before the robot moves, so its clock can't be told"


def test_runs_with_one_fault_are_one_line_with_its_remedy() -> None:
    found = grouped({f"run {number}": LATE for number in range(14)})
    assert found == [f"14 runs (run 0, run 1, run 2, ...): {LATE}; begin recording 1 s earlier"]


def test_reasons_that_differ_in_numbers_are_one_fault() -> None:
    shares = {
        "a": "its track covers 40% of the 10.0 s that it drove",
        "b": "its track covers 7% of the 9.0 s that it drove",
    }
    (line,) = grouped(shares)
    assert line.startswith("2 runs (a, b): of the first, its track covers 40%")
    assert line.endswith("end recording after the robot stands")


def test_a_run_alone_is_named_with_its_reason() -> None:
    assert grouped({"run 3": "something else"}) == ["run 3: something else"]
    assert grouped({}) == []
