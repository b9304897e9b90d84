from mbot_workstation.measure.identification.exclusion import Exclusion, Fault, grouped


def test_runs_with_one_fault_are_one_line_with_its_remedy() -> None:
    late = Exclusion(Fault.LATE_TRACK, "its track begins late")
    assert grouped({f"run {number}": late for number in range(14)}) == [
        "14 runs (run 0, run 1, run 2, ...): its track begins late; begin recording 1 s earlier"
    ]
    shares = {
        name: Exclusion(Fault.SHORT_TRACK, f"its track covers {share}")
        for name, share in {"a": "40%", "b": "7%"}.items()
    }
    (line,) = grouped(shares)
    assert line.startswith("2 runs (a, b): of the first, its track covers 40%; ")
    assert len(grouped(shares | {"c": late})) == 2
    assert grouped({}) == []
