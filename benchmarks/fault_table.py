"""The faults a robot must survive, what is promised for each, and the tests that show it."""

from dataclasses import dataclass

END = "tests/end_to_end"
FIRE = f"{END}/test_under_fire.py"
MODELS = f"{END}/test_model_faults.py"
RELIABILITY = "tests/reliability"
CAMERA = f"{RELIABILITY}/test_camera_faults.py"
BOARD = f"{RELIABILITY}/test_board_faults.py"
PROCESS = f"{RELIABILITY}/test_process_faults.py"
TRUST = "tests/robot/test_trust.py"
SELF = f"{RELIABILITY}/test_self_watch.py"
SOAK = "{soak:,} decisions among random faults"
LOCK_OUT = f"{END}/test_lock_out.py"


@dataclass(frozen=True, slots=True)
class Effort:
    """How much is tried.

    Attributes:
        repeats: of each fault.
        fuzz: inputs to each parser.
        garbage: pieces of it, from the board.
        soak: decisions.

    """

    repeats: int
    fuzz: int
    garbage: int
    soak: int


@dataclass(frozen=True, slots=True)
class Bar:
    """A promise with a number.

    Attributes:
        words: what it says, with the unit.
        measured: the name of the property in which the tests record it.
        most: the largest that keeps the promise, or, with `least`, the smallest.
        least: whether `most` is the smallest instead.

    """

    words: str
    measured: str
    most: float
    least: bool = False

    def is_met(self, values: list[float]) -> bool:
        """Whether every value keeps the promise; there must be one."""
        return bool(values) and all(
            value >= self.most if self.least else value <= self.most for value in values
        )


@dataclass(frozen=True, slots=True)
class Fault:
    """One row: the fault, what is promised, the tests (files, or names in them).

    A name may hold fields of `Effort`.
    """

    name: str
    bars: tuple[Bar, ...]
    tests: tuple[str, ...]
    promise: str = ""  # for a row whose promise the tests themselves decide
    back: str = ""  # what brings the robot back; the tests go through that, too


FAULTS = (
    Fault(
        "camera stalls or dies",
        (
            Bar("stopped ≤ 600 ms<!--camera-stopped--> after the last frame", "stopped ms", 600),
            Bar("recovered ≤ 5 s<!--camera-recovered--> after it returns", "recovered s", 5),
        ),
        (f"{CAMERA}::test_the_robot_stops_for_a_camera_that_ends",),
        back="by itself after a short gap, else `run`",
    ),
    Fault(
        "black, frozen, wrong-shape frames",
        (Bar("0<!--bad-picture-driven--> motor frames", "motor frames", 0),),
        (f"{CAMERA}::test_nothing_is_driven_by_a_bad_picture",),
        back="good frames, then `run`",
    ),
    Fault(
        "serial unplugged",
        (Bar("noticed ≤ 200 ms<!--unplugged-noticed-->", "noticed ms", 200),),
        (f"{BOARD}::test_an_unplugged_board_is_noticed",),
        back="plug it in, then `run`",
    ),
    Fault(
        "{garbage:,} pieces of serial garbage; partial write",
        (
            Bar(
                "≥ 95 %<!--garbage-full-speed--> of them at full speed",
                "at full speed %",
                95,
                least=True,
            ),
            Bar("0<!--garbage-not-stopped--> not stopped", "not stopped", 0),
        ),
        (
            f"{RELIABILITY}/test_serial_garbage.py",
            f"{BOARD}::test_a_torn_write_ends_in_a_stop",
            "tests/firmware/test_torn_frames.py",
        ),
        back="the next command",
    ),
    Fault(
        "board resets",
        (
            Bar(
                "0<!--reset-driven--> motor frames before the handshake",
                "motor frames before the handshake",
                0,
            ),
        ),
        (f"{BOARD}::test_a_board_that_was_reset_is_not_driven_before_it_has_answered",),
        back="`run`",
    ),
    Fault(
        "wrong port, second process",
        (Bar("0<!--wrong-device-driven--> drive frames to a wrong device", "motor frames", 0),),
        (
            f"{BOARD}::test_a_wrong_device_never_gets_a_drive_frame",
            f"{BOARD}::test_a_second_daemon_gets_no_say",
        ),
        back="the right port, or the other's end, then `run`",
    ),
    Fault(
        "inference raises, NaN, infinite",
        (
            Bar(
                "≤ 1<!--bad-model-moved--> decision moves a motor",
                "decisions with the bad model that moved a motor",
                1,
            ),
        ),
        (
            f"{MODELS}::test_a_model_that_answers_nan_stops_the_robot_and_is_rolled_back_after_3",
            "tests/robot/test_control_loop.py::"
            "test_a_model_that_answers_nonsense_stops_and_is_given_up",
        ),
        back="rolled back, then `run`",
    ),
    Fault(
        "inference takes 2 s",
        (
            Bar(
                "stopped ≤ 600 ms<!--late-decision-stopped--> after the last decision",
                "stopped ms",
                600,
            ),
        ),
        (f"{PROCESS}::test_a_decision_that_takes_2_s_stops_the_robot",),
        back="`run`",
    ),
    Fault(
        "SIGKILL, out of memory",
        (
            Bar("motors off ≤ 350 ms<!--deadman-stopped-->", "motors off ms", 350),
            Bar("there again, and standing, ≤ 10 s<!--killed-there-again-->", "there again s", 10),
        ),
        (
            "tests/firmware/test_whole_loop.py::"
            "test_the_robot_stops_soon_after_its_daemon_was_killed",
            f"{PROCESS}::test_a_killed_daemon_is_there_again_soon_and_waits_for_a_word",
            f"{END}/test_daemon.py::test_stop_motors_is_what_systemd_runs_after_a_crash",
        ),
        back="systemd, then `run`",
    ),
    Fault(
        "SIGSTOP",
        (Bar("0<!--expired-obeyed--> expired commands obeyed", "obeyed", 0),),
        (
            f"{END}/test_stale_commands.py",
            "tests/firmware/test_daemon_with_firmware.py::"
            "test_a_frozen_daemon_stops_in_time_and_stays_stopped",
            "tests/robot/test_systemd_unit.py::"
            "test_a_hung_or_dead_daemon_is_replaced_and_the_motors_are_stopped",
        ),
        back="SIGCONT or the watchdog, then `run`",
    ),
    Fault(
        "clock jumps by 10 years",
        (Bar("0<!--clock-jump-missed--> missed decisions", "missed decisions", 0),),
        (
            f"{PROCESS}::test_a_clock_that_jumps_by_ten_years_changes_nothing",
            f"{TRUST}::test_a_clock_that_jumps_by_ten_years_changes_nothing",
        ),
        back="nothing is needed",
    ),
    Fault(
        "disk full, EIO",
        (
            Bar(
                "old model loads, 100 %<!--full-disk-loads-->", "old model loads %", 100, least=True
            ),
        ),
        (
            f"{RELIABILITY}/test_full_disk.py",
            "tests/robot/test_killed_by_strace.py::"
            "test_a_disk_that_refuses_at_any_call_keeps_the_old_model",
            "tests/robot/test_crash_points.py::test_a_disk_that_refuses_at_any_point_costs_no_model",
        ),
        back="room, then the push again",
    ),
    Fault(
        "power cut during activation",
        (),
        (
            "tests/robot/test_crash_points.py::"
            "test_after_a_power_cut_at_any_point_one_whole_model_loads",
            "tests/robot/test_killed_by_strace.py::"
            "test_killed_at_any_call_the_old_model_or_the_new_one_loads_whole",
            "tests/robot/test_model_life.py",
        ),
        "every crash point loads the old or the new model",
        back="the next start",
    ),
    Fault(
        "power cut while recording",
        (Bar("lost ≤ 1 s<!--power-cut-lost-->, never a file", "lost s", 1),),
        (
            f"{RELIABILITY}/test_recording_power_cut.py",
            "tests/workstation/test_telemetry_file.py::test_every_cut_gives_back_a_beginning",
        ),
        back="the next start",
    ),
    Fault(
        "network partition",
        (
            Bar("0<!--missed-when-cut--> missed decisions when cut", "cut: missed decisions", 0),
            Bar(
                "0<!--missed-when-frozen--> missed decisions when frozen",
                "frozen: missed decisions",
                0,
            ),
        ),
        (f"{END}/test_network_partition.py",),
        back="by itself",
    ),
    Fault(
        "workstation dies in mid-push",
        (),
        (
            f"{MODELS}::test_a_workstation_that_dies_in_mid_push_leaves_nothing_behind",
            "tests/robot/test_model_service.py::"
            "test_the_memory_of_a_push_whose_sender_died_comes_back",
        ),
        "nothing visible; memory back within 60 s<!--push-memory-back-->",
        back="the push again",
    ),
    Fault(
        "1,000 malformed messages on each key",
        (
            Bar("STOP meanwhile ≤ 100 ms<!--stop-malformed-median-->, median", "stop p50 ms", 100),
            Bar("STOP meanwhile ≤ 100 ms<!--stop-malformed-worst-->, worst", "stop worst ms", 100),
            Bar("memory + ≤ 20 MB<!--malformed-memory-->", "memory MB", 20),
        ),
        (f"{FIRE}::test_malformed_messages_are_refused_and_a_stop_gets_through",),
        back="nothing is needed",
    ),
    Fault(
        "giant payload (64 MiB)",
        (Bar("memory + ≤ 16 MB<!--giant-memory-->", "memory MB", 16),),
        (
            f"{FIRE}::test_a_giant_payload_is_never_put_together",
            f"{FIRE}::test_a_request_just_over_its_limit_never_reaches_the_daemon",
        ),
        back="nothing is needed",
    ),
    Fault(
        "replay, downgrade, other robot's model, unsigned",
        (),
        tuple(
            f"{TRUST}::{name}"
            for name in (
                "test_a_recorded_push_cannot_be_replayed",
                "test_nor_by_another_start_of_the_daemon",
                "test_a_downgrade_is_refused_unless_it_is_signed_as_one",
                "test_another_robots_model_is_refused",
                "test_an_unsigned_model_is_refused",
                "test_a_strangers_signature_is_refused",
            )
        ),
        "none accepted",
        back="nothing is needed",
    ),
    Fault(
        "wrong input shape",
        (),
        (
            f"{TRUST}::test_a_wrong_input_shape_is_refused_before_a_byte_is_sent",
            "tests/protocol/test_dry_run.py::test_a_bad_model_is_refused_in_one_line",
            "tests/robot/test_model_service.py::test_a_bad_model_leaves_the_old_one",
        ),
        "the old model stays active",
        back="nothing is needed",
    ),
    Fault(
        "hostile ONNX (huge tensor, endless loop, other files)",
        (Bar("child killed ≤ 10 s<!--hostile-model-killed-->", "refused after s", 10),),
        (
            "tests/protocol/test_dry_run.py::test_a_model_that_never_answers_is_killed_within_10_s",
            f"{MODELS}::test_a_hostile_model_leaves_the_driving_daemon_alone",
            "tests/protocol/test_model_structure.py",
        ),
        back="nothing is needed",
    ),
    Fault(
        "slow subscriber",
        (Bar("publishing ≤ 10 ms<!--published-->, p99", "publish p99 ms", 10),),
        (f"{FIRE}::test_a_subscriber_that_stopped_reading_holds_nobody_up",),
        back="it is given up, and reconnects",
    ),
    Fault(
        "two pushes at once",
        (),
        (
            f"{MODELS}::test_of_two_pushes_at_once_exactly_one_wins_and_the_other_learns_why",
            "tests/robot/test_model_service.py::"
            "test_of_two_pushes_at_once_one_wins_and_the_other_learns_why",
        ),
        "exactly one wins, the other learns why",
        back="the other pushes again",
    ),
    Fault(
        "SIGTERM in motion",
        (
            Bar("frame out ≤ 20 ms<!--stop-frame-out-->, median", "frame p50 ms", 20),
            Bar("frame out ≤ 20 ms<!--stop-frame-out-->, worst", "frame worst ms", 20),
            Bar(
                "acknowledged ≤ 100 ms<!--stop-acknowledged-->, worst", "acknowledged worst ms", 100
            ),
        ),
        (f"{PROCESS}::test_sigterm_in_motion_stops_at_once",),
        back="a start, then `run`",
    ),
    Fault(
        "new model crashes the daemon",
        (Bar("rolled back within 3<!--crash-starts--> starts", "starts", 3),),
        (f"{MODELS}::test_a_model_that_crashes_the_daemon_is_rolled_back_within_3_starts",),
        back="rolled back, then `run`",
    ),
)

BESIDE = (
    Fault(
        "commands from before a stop",
        (),
        (
            f"{END}/test_arming.py",
            "tests/robot/test_arming.py",
            "tests/robot/test_command_service.py",
        ),
        "none moves the robot after it",
        back="look, then `run`",
    ),
    Fault(
        "a short gap of the camera",
        (Bar("drives on ≤ 5 s<!--short-gap-driven-on-->", "drives on s", 5),),
        (f"{CAMERA}::test_a_short_gap_of_the_camera_is_forgiven",),
        back="by itself",
    ),
    Fault(
        "a wall, a cable",
        (Bar("stopped after ≤ 4 s<!--stuck-stopped--> of driving", "stuck, stopped after s", 4),),
        (
            f"{END}/test_stuck.py",
            "tests/robot/test_stuck.py",
            "tests/workstation/test_stuck_simulated.py",
        ),
        back="`run`",
    ),
    Fault(
        "a thread that dies, or hangs",
        (Bar("process ended ≤ 1.5 s<!--dead-thread-ended-->", "ended ms", 1500),),
        (
            f"{SELF}::test_an_exception_that_ends_any_thread_ends_the_process_with_the_motors_off",
            f"{SELF}::test_a_thread_that_hangs_starves_the_watchdog",
        ),
        back="systemd, then `run`",
    ),
    Fault(
        "SIGHUP, SIGQUIT, SIGINT in motion",
        (Bar("frame out ≤ 20 ms<!--stop-frame-out-->", "frame ms", 20),),
        (f"{SELF}::test_every_signal_that_ends_it_stops_the_motors_first",),
        back="a start, then `run`",
    ),
    Fault(
        "a log that nobody reads",
        (
            Bar("STOP ≤ 100 ms<!--stop-log-unread-->", "STOP ms", 100),
            Bar("with the board lost ≤ 150 ms<!--stop-board-lost-->", "STOP, board lost, ms", 150),
        ),
        (f"{SELF}::test_a_log_that_nobody_reads_holds_up_no_stop",),
        back="nothing is needed",
    ),
    Fault(
        "16 quiet sessions of somebody revoked",
        (
            Bar("STOP of a viewer ≤ 100 ms<!--stop-quiet-sessions-->", "STOP worst ms", 100),
            Bar("out within 1 s<!--revoked-out-->", "out after s", 1),
        ),
        (
            f"{LOCK_OUT}::test_quiet_sessions_of_somebody_revoked_keep_nobody_from_a_stop",
            f"{LOCK_OUT}::test_somebody_off_the_roll_is_out_within_a_second",
        ),
        back="nothing is needed",
    ),
    Fault(
        "a viewer's flood of tokens",
        (
            Bar(
                "≤ 0.1<!--flood-share--> of the flooder's processor time",
                "share of the flooder's",
                0.1,
            ),
            Bar("STOP ≤ 100 ms<!--stop-token-flood-->", "STOP worst ms", 100),
        ),
        (f"{LOCK_OUT}::test_a_viewers_flood_of_tokens_costs_little_and_holds_up_no_stop",),
        back="nothing is needed",
    ),
    Fault(
        "{fuzz:,} inputs to each parser",
        (),
        (f"{RELIABILITY}/test_fuzz.py",),
        "a value or a clear error",
        back="nothing is needed",
    ),
    Fault(
        "an enrolled robot behind a router",
        (),
        (
            f"{END}/test_daemon_behind_router.py",
            f"{END}/test_router.py",
        ),
        "STOP and every command come through, or nothing sets it in motion",
        back="connect to the robot itself, or upgrade",
    ),
    Fault(
        "a viewer who reads nothing, says STOP without end, or is gone without a word",
        (
            Bar(
                "STOP of others ≤ 100 ms<!--stop-under-attack-->, second worst",
                "STOP second worst ms",
                100,
            ),
            Bar("and < 1,000 ms<!--stop-under-attack-worst-->, worst", "STOP worst ms", 999),
            Bar("0<!--driven-under-attack--> drive frames after it", "drive frames after STOP", 0),
        ),
        (
            f"{END}/test_stop_under_attack.py",
            "tests/protocol/test_connected_sockets.py",
            "tests/robot/test_doorkeeper.py",
            "tests/robot/test_session_guard.py",
            "tests/robot/test_short_lives.py",
        ),
        back="it is shown out; others need nothing",
    ),
    Fault(
        "somebody comes to look at a robot that waits",
        (),
        (
            "tests/robot/test_control_loop.py::test_waiting_is_not_a_gap_but_has_an_end",
            "tests/robot/test_control_loop.py::test_a_word_is_over_when_nobody_is_there_any_more",
        ),
        "nothing moves",
        back="`run`",
    ),
    Fault(
        "a hand's command that was held up",
        (),
        (
            "tests/robot/test_helm.py",
            "tests/robot/test_command_service.py::"
            "test_a_hands_command_lives_no_longer_than_it_holds",
            "tests/workstation/test_by_hand.py::test_keys_that_were_held_up_drive_nothing",
        ),
        "it moves nothing",
        back="take hold again",
    ),
    Fault(
        "a crash on a full disk, told to drive at a start",
        (),
        ("tests/robot/test_last_end.py::test_without_a_mark_nothing_drives_by_itself",),
        "it stands, and says why",
        back="room, or `run`",
    ),
    Fault(
        "a disk that fills up during a release's trial",
        (),
        (
            "tests/robot/test_update_steps.py::"
            "test_a_disk_that_fills_up_during_a_trial_leaves_the_old_release_running",
            "tests/robot/test_update_steps.py::"
            "test_a_full_disk_keeps_no_dead_release_from_going_back",
        ),
        "the old release runs",
        back="room, then the update again",
    ),
    Fault(
        "a ring of a stuck camera's buffers",
        (),
        (
            "tests/robot/test_camera.py::"
            "test_a_ring_of_old_pictures_is_frozen_as_soon_as_nothing_new_has_come",
        ),
        "refused as frozen",
        back="new pictures, then `run`",
    ),
    Fault(
        "a camera's picture that is dear to decode, or half of one",
        (),
        ("tests/robot/test_jpeg_picture.py", "tests/robot/test_mjpeg_source.py"),
        "refused before it is decoded, or called cut off",
        back="the next picture",
    ),
    Fault(
        "a model's trial that asks the kernel for more than a computation needs",
        (),
        ("tests/protocol/test_confinement.py",),
        "refused",
        back="nothing is needed",
    ),
    Fault(
        "pictures, chunks and archives of strangers that unpack to gigabytes",
        (),
        (
            "tests/workstation/test_picture_file.py",
            "tests/protocol/test_whole_chunks.py",
            "tests/workstation/test_glb_file.py",
        ),
        "one line before anything is unpacked",
        back="nothing is needed",
    ),
    Fault(
        "a clock of the robot's that is wrong, recordings",
        (),
        (
            "tests/robot/test_recording_directory.py::"
            "test_a_clock_that_is_wrong_costs_nothing_until_ten_drives_say_so",
        ),
        "no drive is deleted for it",
        back="nothing is needed",
    ),
    Fault(
        "a phone's narrow screen, long names",
        (),
        (
            f"{END}/test_console_page.py::"
            "test_stop_is_whole_and_can_be_hit_on_every_screen_whatever_the_texts_are",
        ),
        "STOP is whole and in reach",
        back="nothing is needed",
    ),
    Fault(
        SOAK,
        (
            Bar("memory + ≤ 20 MB<!--soak-memory-->", "memory MB", 20),
            Bar("threads + ≤ 2<!--soak-threads-->", "threads", 2),
            Bar("descriptors + ≤ 3<!--soak-descriptors-->", "descriptors", 3),
            Bar("0<!--soak-silences--> silences while moving", "silences while moving", 0),
        ),
        (f"{RELIABILITY}/test_soak.py",),
        back="by itself",
    ),
)
"""Not in the table of faults, but promised as well."""
