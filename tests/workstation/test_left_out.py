from mbot_workstation.measure.identification.left_out import Fault, LeftOut, grouped, reasons

LATE = LeftOut(Fault.BEGINS_LATE, "its track begins late")


def test_runs_with_one_fault_are_one_line_with_its_remedy() -> None:
    found = grouped({f"run {number}": LATE for number in range(14)})
    assert found == [f"14 runs (run 0, run 1, run 2, ...): {LATE.why}; begin recording 1 s earlier"]


def test_reasons_that_differ_in_numbers_are_one_fault() -> None:
    shares = {name: LeftOut(Fault.ENDS_EARLY, f"covers {name}") for name in ("40%", "7%")}
    (line,) = grouped(shares)
    assert line.startswith("2 runs (40%, 7%): of the first, covers 40%;")


def test_a_run_alone_is_named_with_its_reason() -> None:
    assert reasons({"run 3": LATE}) == {"run 3": LATE.why}
    assert len(grouped({"run 3": LATE, "run 4": LeftOut(Fault.OFF_TIME, "late")})) == 2
    assert grouped({}) == []
