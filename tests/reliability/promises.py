"""Every number that the documents promise, and the assertion that holds it.

`tests/test_promises.py` reads the tables of the documents beside this one: a number there which is
missing here fails, and so does an assertion that is gone or asserts less than the document says.
Numbers count that are written in digits.
"""

from dataclasses import dataclass

MS = 1e-3
"""Asserted in thousandths of what the document counts in."""


@dataclass(frozen=True, slots=True)
class Promise:
    """One number of a document.

    Attributes:
        said: the document's words; the first number in them is meant.
        test: file and function below `tests`; or another file, in which `asserts` must stand.
        asserts: what holds it: a comparison within an `assert`, or a call of `within`.
        unit: of the asserted number, in the document's.

    """

    said: str
    test: str
    asserts: str
    unit: float = 1.0


ARMING = "robot/test_command_service.py"
CAMERA = "reliability/test_camera_faults.py"
BOARD = "reliability/test_board_faults.py"
PROCESS = "reliability/test_process_faults.py"
SELF = "reliability/test_self_watch.py"
FIRE = "end_to_end/test_under_fire.py"
LOCK_OUT = "end_to_end/test_lock_out.py"
LOOP = "robot/test_control_loop.py"
STUCK = "robot/test_stuck.py::test_a_picture_that_stands_still_for_3_s_of_driving_is_stuck"
BORDER = "end_to_end/test_stuck.py::test_a_robot_at_the_border_stops_and_says_that_it_is_stuck"
ATTACK = (
    "end_to_end/test_stop_under_attack.py::"
    "test_no_viewer_keeps_anybody_elses_stop_from_being_confirmed"
)
CAMERA_ENDS = f"{CAMERA}::test_the_robot_stops_for_a_camera_that_ends"
SLOW = f"{PROCESS}::test_a_decision_that_takes_2_s_stops_the_robot"
SIGTERM = f"{PROCESS}::test_sigterm_in_motion_stops_at_once"
SIGNALS = f"{SELF}::test_every_signal_that_ends_it_stops_the_motors_first"
LOG = f"{SELF}::test_a_log_that_nobody_reads_holds_up_no_stop"
KILLED = "firmware/test_whole_loop.py::test_the_robot_stops_soon_after_its_daemon_was_killed"
FROZEN = (
    "firmware/test_daemon_with_firmware.py::test_a_frozen_daemon_stops_in_time_and_stays_stopped"
)
HOSTILE = "protocol/test_dry_run.py::test_a_model_that_never_answers_is_killed_within_10_s"
OFF_THE_ROLL = f"{LOCK_OUT}::test_somebody_off_the_roll_is_out_within_a_second"
QUIET = f"{LOCK_OUT}::test_quiet_sessions_of_somebody_revoked_keep_nobody_from_a_stop"
FLOOD = f"{LOCK_OUT}::test_a_viewers_flood_of_tokens_costs_little_and_holds_up_no_stop"
MALFORMED = f"{FIRE}::test_malformed_messages_are_refused_and_a_stop_gets_through"
PARTITION = "test_network_partition.py::test_by_default_the_robot_drives_on_and_misses_nothing"
GARBAGE = "reliability/test_serial_garbage.py::test_garbage_from_the_board_ends_stopped"
SOAK = "reliability/test_soak.py::test_nothing_leaks_and_every_silence_begins_standing"
MODELS = "end_to_end/test_model_faults.py"

PROMISES: dict[str, tuple[Promise, ...]] = {
    "arming.md": (
        Promise(
            "count + 1",
            f"{ARMING}::test_a_damaged_stop_stops",
            "service.stop(payload).stop_count - before == 1",
        ),
        Promise(
            "good for more than 2 s",
            f"{ARMING}::test_nobody_has_a_command_for_later_in_his_pocket",
            "LONGEST_EXPIRY_NS == 2 * 10 ** 9",
            1e-9,
        ),
        Promise(
            "away for up to 2 s",
            f"{LOOP}::test_a_gap_that_is_longer_than_forgiven_disarms",
            "longest_s == 2",
        ),
        Promise(
            "once, within 30 s",
            f"{LOOP}::test_waiting_is_not_a_gap_but_has_an_end",
            "longest_s == 30",
        ),
        Promise(
            "ends with 7",
            "workstation/test_main.py::test_armed_but_standing_says_for_what_it_waits",
            "done.returncode == 7",
        ),
        Promise("drives for 3 s", STUCK, "found_after_s(STANDING[name], FAST, period_s=0.1) == 3"),
    ),
    "safety.md": (
        Promise("no STOP: 100 ms", LOG, "second_worst(stop_ms) < STOP_BAR_MS"),
        Promise("is confirmed within 100 ms", ATTACK, "second_worst(found.confirmed_ms) <= 100"),
        Promise("within 600 ms of the last frame", CAMERA_ENDS, "within(600, stopped_ms)"),
        Promise("stops within 4 s", BORDER, "within(4, stopped_s)"),
        Promise("within 600 ms of the last one", SLOW, "within(600, stopped_ms)"),
        Promise("on its way within 20 ms", SIGTERM, "second_worst(frame_ms) <= 20"),
        Promise("on its way within 20 ms", SIGNALS, "second_worst(frame_ms) < 20"),
        Promise(
            "off within 350 ms",
            KILLED,
            "TIMEOUT_US - 1000 <= board.changed_us - board.heard_us <= TIMEOUT_US + BAR_US",
            MS,
        ),
        Promise(
            "off within 350 ms",
            FROZEN,
            "TIMEOUT_MS - 1 <= silence_ms(board) <= TIMEOUT_MS + BAR_MS",
        ),
    ),
    "security.md": (
        Promise("within 1 s of the handshake", OFF_THE_ROLL, "out_s <= 1"),
        Promise(
            "dropped after 60 s",
            "robot/test_model_service.py::test_a_push_that_trickles_is_forgotten_after_a_minute",
            "59 <= taken_s - began_s <= 60",
        ),
        Promise("within 10 s", HOSTILE, "time.monotonic() - began_s <= 10.0"),
        Promise(
            "32 sessions",
            f"{FIRE}::test_no_more_sessions_than_may_be_and_those_there_are_go_on",
            "MOST_SESSIONS == 32",
        ),
        Promise("100,000 inputs to each", "Makefile", "MBOT_FUZZ_CASES=100000"),
        Promise(
            "at most 1.6",
            "robot/test_systemd_unit.py::test_exposure_is_low",
            "float(told[1]) <= 1.6",
        ),
    ),
    "results/reliability.md": (
        Promise("stopped ≤ 600 ms after the last frame", CAMERA_ENDS, "within(600, stopped_ms)"),
        Promise("recovered ≤ 5 s", CAMERA_ENDS, "second_worst(recovered_s) <= 5"),
        Promise(
            "0 motor frames", f"{CAMERA}::test_nothing_is_driven_by_a_bad_picture", "frames == 0"
        ),
        Promise(
            "noticed ≤ 200 ms",
            f"{BOARD}::test_an_unplugged_board_is_noticed",
            "within(200, noticed_ms)",
        ),
        Promise("≥ 95 % of them at full speed", GARBAGE, "share_percent >= 95"),
        Promise("0 not stopped", GARBAGE, "not_stopped == 0"),
        Promise(
            "0 motor frames before the handshake",
            f"{BOARD}::test_a_board_that_was_reset_is_not_driven_before_it_has_answered",
            "within(0, frames)",
        ),
        Promise(
            "0 drive frames to a wrong device",
            f"{BOARD}::test_a_wrong_device_never_gets_a_drive_frame",
            "frames == 0",
        ),
        Promise(
            "0 drive frames to a wrong device",
            f"{BOARD}::test_a_second_daemon_gets_no_say",
            "frames == 0",
        ),
        Promise(
            "≤ 1 decision moves a motor",
            f"{MODELS}::test_a_model_that_answers_nan_stops_the_robot_and_is_rolled_back_after_3",
            "moved == 0",
        ),
        Promise("stopped ≤ 600 ms after the last decision", SLOW, "within(600, stopped_ms)"),
        Promise(
            "motors off ≤ 350 ms",
            KILLED,
            "TIMEOUT_US - 1000 <= board.changed_us - board.heard_us <= TIMEOUT_US + BAR_US",
            MS,
        ),
        Promise(
            "there again, and standing, ≤ 10 s",
            f"{PROCESS}::test_a_killed_daemon_is_there_again_soon_and_waits_for_a_word",
            "within(10, again_s)",
        ),
        Promise(
            "0 expired commands obeyed",
            "end_to_end/test_stale_commands.py::test_no_command_older_than_its_expiry_is_obeyed",
            "obeyed == 0",
        ),
        Promise(
            "0 missed decisions",
            f"{PROCESS}::test_a_clock_that_jumps_by_ten_years_changes_nothing",
            "within(0, missed)",
        ),
        Promise(
            "old model loads, 100 %",
            "reliability/test_full_disk.py::"
            "test_a_disk_that_takes_nothing_keeps_the_old_model_and_the_robot_driving",
            "loads_percent == 100",
        ),
        Promise(
            "lost ≤ 1 s",
            "reliability/test_recording_power_cut.py::"
            "test_a_recording_that_was_cut_off_lacks_less_than_a_second",
            "within(1, lost_s)",
        ),
        Promise(
            "0 missed decisions when cut",
            f"end_to_end/{PARTITION}",
            "within(0, lambda: observer.missed_in(LONGER_THAN_THE_LEASE_S))",
        ),
        Promise(
            "0 missed decisions when frozen",
            f"end_to_end/{PARTITION}",
            "within(0, lambda: observer.missed_in(LONGER_THAN_THE_LEASE_S))",
        ),
        Promise(
            "memory back within 60 s",
            "robot/test_model_service.py::test_the_memory_of_a_push_whose_sender_died_comes_back",
            "after_s <= 60",
        ),
        Promise("≤ 100 ms, median", MALFORMED, "statistics.median(stops_ms) <= 100"),
        Promise("≤ 100 ms, worst", MALFORMED, "within(100, worst_ms)"),
        Promise("memory + ≤ 20 MB", MALFORMED, "growth_mb <= 20"),
        Promise(
            "memory + ≤ 16 MB",
            f"{FIRE}::test_a_giant_payload_is_never_put_together",
            "memory.growth_mb <= 16",
        ),
        Promise("child killed ≤ 10 s", HOSTILE, "time.monotonic() - began_s <= 10.0"),
        Promise(
            "publishing ≤ 10 ms",
            f"{FIRE}::test_a_subscriber_that_stopped_reading_holds_nobody_up",
            "p99_ms <= 10",
        ),
        Promise("frame out ≤ 20 ms", SIGTERM, "second_worst(frame_ms) <= 20"),
        Promise("acknowledged ≤ 100 ms", SIGTERM, "second_worst(acknowledged_ms) <= 100"),
        Promise(
            "rolled back within 3 starts",
            f"{MODELS}::test_a_model_that_crashes_the_daemon_is_rolled_back_within_3_starts",
            "starts <= 3",
        ),
        Promise(
            "drives on ≤ 5 s",
            f"{CAMERA}::test_a_short_gap_of_the_camera_is_forgiven",
            "within(5, recovered_s)",
        ),
        Promise("stopped after ≤ 4 s of driving", BORDER, "within(4, stopped_s)"),
        Promise(
            "process ended ≤ 1.5 s",
            f"{SELF}::test_an_exception_that_ends_any_thread_ends_the_process_with_the_motors_off",
            "second_worst(ended_ms) < 1500",
            MS,
        ),
        Promise("frame out ≤ 20 ms", SIGNALS, "second_worst(frame_ms) < 20"),
        Promise("STOP ≤ 100 ms", LOG, "second_worst(stop_ms) < STOP_BAR_MS"),
        Promise("with the board lost ≤ 150 ms", LOG, "second_worst(lost_ms) < STOP_BAR_MS + 50"),
        Promise("STOP of a viewer ≤ 100 ms", QUIET, "second_worst(found) <= 100"),
        Promise("out within 1 s", OFF_THE_ROLL, "out_s <= 1"),
        Promise("≤ 0.1 of the flooder's processor time", FLOOD, "within(0.1, share)"),
        Promise("STOP ≤ 100 ms", FLOOD, "second_worst(stop_ms) <= 100"),
        Promise("STOP of others ≤ 100 ms", ATTACK, "second_worst(found.confirmed_ms) <= 100"),
        Promise("and < 1,000 ms, worst", ATTACK, "max(found.confirmed_ms) < 1000"),
        Promise("0 drive frames after it", ATTACK, "sum(found.driven_after) == 0"),
        Promise("memory + ≤ 20 MB", SOAK, "after.memory_mb - before.memory_mb <= 20"),
        Promise("threads + ≤ 2", SOAK, "after.threads - before.threads <= 2"),
        Promise("descriptors + ≤ 3", SOAK, "after.files - before.files <= 3"),
        Promise("0 silences while moving", SOAK, "silences == 0"),
    ),
}
