"""The mutants of `benchmarks/mutants.py`: what is broken, and the test that must notice."""

from dataclasses import dataclass

ROBOT = "robot/mbot_agent"
PROTOCOL = "shared/protocol/mbot_protocol"
T = "tests/robot"


@dataclass(frozen=True, slots=True)
class Mutant:
    """One small fault.

    Attributes:
        name: what is wrong with it.
        file: where; `was` is there exactly once.
        was, becomes: the text before and after.
        test: must fail with it.

    """

    name: str
    file: str
    was: str
    becomes: str
    test: str


CAPTURE = f"{ROBOT}/camera/capture.py"
MOTORS = f"{ROBOT}/board/motors.py"
SESSION = f"{ROBOT}/board/board_session.py"
ARMING = f"{ROBOT}/arming.py"
HELM = f"{ROBOT}/helm.py"
LOOP = f"{ROBOT}/control_loop.py"
SERVICE = f"{ROBOT}/commands/command_service.py"
TRUST = f"{ROBOT}/models/trust.py"
UPDATER = "robot/mbot_update"
WORKSTATION = "workstation/mbot_workstation"
W = "tests/workstation"

MUTANTS = (
    Mutant(
        "a stale frame is fresh four times as long",
        CAPTURE,
        "newest.captured_ns <= self._stale_after_ns",
        "newest.captured_ns <= 4 * self._stale_after_ns",
        f"{T}/test_camera.py::test_a_picture_is_stale_after_what_is_configured",
    ),
    Mutant(
        "a refused frame leaves the last good one fresh",
        CAPTURE,
        "self._newest = shot if fault is None else None",
        "self._newest = shot if fault is None else self._newest",
        f"{T}/test_camera.py::test_a_refused_frame_ends_freshness_at_once",
    ),
    Mutant(
        "a black frame is decided on",
        CAPTURE,
        "        if is_black(picture):",
        "        if False and is_black(picture):",
        f"{T}/test_camera.py::"
        "test_a_bad_picture_that_was_not_decoded_yet_is_never_decided_on[black]",
    ),
    Mutant(
        "a frozen camera is never noticed",
        f"{ROBOT}/camera/picture_check.py",
        "            self._frozen = True\n",
        "            self._frozen = False\n",
        f"{T}/test_camera.py::test_a_sensor_that_repeats_itself_is_frozen_after_300_ms",
    ),
    Mutant(
        "another shape is believed",
        f"{ROBOT}/camera/picture_check.py",
        '        if shape != self._shape or kind != "uint8":',
        '        if kind != "uint8":',
        f"{T}/test_camera.py::test_another_shape_is_found_without_decoding",
    ),
    Mutant(
        "a redirected camera is followed",
        f"{ROBOT}/camera/opencv_source.py",
        "max_redirects;0",
        "max_redirects;8",
        f"{T}/test_mjpeg_source.py::test_nobody_sends_us_to_another_address",
    ),
    Mutant(
        "half a second before the stop frame",
        MOTORS,
        "        began_ns = time.monotonic_ns()\n        session.stop()",
        "        began_ns = time.monotonic_ns()\n        time.sleep(0.5)\n        session.stop()",
        f"{T}/test_motors.py::test_a_stop_is_on_the_wire_within_20_ms",
    ),
    Mutant(
        "the deadline is not looked at",
        MOTORS,
        "time.monotonic_ns() >= command.deadline_ns or not command.guard()",
        "not command.guard()",
        f"{T}/test_motors.py::test_a_command_is_refreshed_until_its_deadline_and_no_longer",
    ),
    Mutant(
        "the guard is not asked",
        MOTORS,
        "time.monotonic_ns() >= command.deadline_ns or not command.guard()",
        "time.monotonic_ns() >= command.deadline_ns",
        f"{T}/test_motors.py::test_a_guard_that_turns_false_stops_the_motors",
    ),
    Mutant(
        "a command outlives a halt",
        MOTORS,
        "            self._halted = True\n            self._command = None\n",
        "            self._command = None\n",
        f"{T}/test_motors.py::test_stop_and_halt",
    ),
    Mutant(
        "a command is kept for a board that is not there",
        MOTORS,
        "if self._halted or self.fault is not None:",
        "if self._halted:",
        f"{T}/test_motors.py::test_stock_firmware_drives_only_when_accepted",
    ),
    Mutant(
        "stock firmware is driven unasked",
        MOTORS,
        "if fault is None and not (self.has_deadman or self._board.accept_no_deadman):",
        "if fault is None and False:",
        f"{T}/test_motors.py::test_stock_firmware_drives_only_when_accepted",
    ),
    Mutant(
        "a reset is not counted",
        MOTORS,
        "self._resets += 1",
        "self._resets += 0",
        f"{T}/test_motors.py::test_a_reset_board_is_not_driven_before_a_new_handshake",
    ),
    Mutant(
        "standing is claimed for a board that does not answer",
        MOTORS,
        "            return self._stood_ns >= asked_ns\n",
        "            return True\n",
        f"{T}/test_motors.py::test_that_it_stands_is_the_boards_word",
    ),
    Mutant(
        "an old stop counts as the answer to a new one",
        MOTORS,
        "        asked_ns = time.monotonic_ns()\n        with self._news:\n"
        "            self._asked_to_stand",
        "        asked_ns = 0\n        with self._news:\n            self._asked_to_stand",
        f"{T}/test_motors.py::test_that_it_stands_is_the_boards_word",
    ),
    Mutant(
        "one acknowledgement is enough for a stop",
        SESSION,
        "STOP_REPEATS = 2",
        "STOP_REPEATS = 1",
        f"{T}/test_motors.py::test_a_stop_is_acknowledged_twice",
    ),
    Mutant(
        "a missing acknowledgement is taken for one",
        SESSION,
        '        raise UnacknowledgedError(f"{self.path} does not acknowledge commands")',
        "        return written_ns, time.monotonic_ns()",
        f"{T}/test_motors.py::test_a_mute_board_is_a_fault_and_gets_stopped_when_it_is_back",
    ),
    Mutant(
        "a reset behind an acknowledgement is overlooked",
        SESSION,
        "            if any(isinstance(reply, Banner) for reply in replies):",
        "            if False:",
        "tests/reliability/test_board_faults.py::"
        "test_a_reset_announced_right_behind_an_acknowledgement_counts",
    ),
    Mutant(
        "the port is not stopped when it is left",
        SESSION,
        "            if not isinstance(error, BoardLostError):\n                self.stop()",
        "            if False:\n                self.stop()",
        f"{T}/test_motors.py::test_leaving_the_context_stops_the_motors",
    ),
    Mutant(
        "the handshake begins without a stop",
        SESSION,
        "        self._write(mcore.stop_burst())\n        deadline",
        "        deadline",
        f"{T}/test_motors.py::test_the_board_is_stopped_before_anything_else",
    ),
    Mutant(
        "the handshake spins",
        SESSION,
        "self._read(again - time.monotonic(), wakeable=False)",
        "self._read(again - time.monotonic())",
        f"{T}/test_motors.py::test_waiting_for_a_board_is_not_spinning",
    ),
    Mutant(
        "the stop counter is ignored",
        ARMING,
        "if seen_stops != self.stop.count:",
        "if False:",
        f"{T}/test_arming.py::test_who_knows_an_older_stop_arms_nothing",
    ),
    Mutant(
        "a larger counter is good as well",
        ARMING,
        "if seen_stops != self.stop.count:",
        "if seen_stops < self.stop.count:",
        f"{T}/test_command_service.py::test_what_was_meant_for_another_moment_is_refused",
    ),
    Mutant(
        "a stop does not count",
        ARMING,
        "Stop(self.stop.count + 1, by, why, now_ns)",
        "Stop(self.stop.count, by, why, now_ns)",
        f"{T}/test_command_service.py::"
        "test_nothing_that_was_sent_before_a_stop_moves_the_robot_after_it",
    ),
    Mutant(
        "a stop leaves a decision that was begun in force",
        ARMING,
        "return replace(self._to(Mode.STOPPED), stop=stop)",
        "return replace(self, mode=Mode.STOPPED, stop=stop)",
        f"{T}/test_arming.py::test_a_stop_outdates_what_was_begun_before_it",
    ),
    Mutant(
        "a long gap is forgiven",
        ARMING,
        "return faults[0] if now_ns - self._since_ns > self._longest_ns else None",
        "return None",
        f"{T}/test_control_loop.py::test_a_gap_that_is_longer_than_forgiven_disarms",
    ),
    Mutant(
        "a helm without its lock",
        HELM,
        "            if self._orders != orders:\n                return None\n",
        "",
        f"{T}/test_helm.py::test_a_decision_begun_before_a_stop_never_reaches_the_motors",
    ),
    Mutant(
        "a stop that only notes it",
        HELM,
        "stopped(time.monotonic_ns(), by=by)\n            self._board.disarm()\n"
        "            self._board.stop()",
        "stopped(time.monotonic_ns(), by=by)\n            self._board.disarm()",
        f"{T}/test_helm.py::test_a_decision_begun_before_a_stop_never_reaches_the_motors",
    ),
    Mutant(
        "a stop that leaves ARM to be said",
        HELM,
        "stopped(time.monotonic_ns(), by=by)\n            self._board.disarm()",
        "stopped(time.monotonic_ns(), by=by)",
        f"{T}/test_helm.py::test_the_board_is_armed_by_a_word_and_disarmed_by_a_stop",
    ),
    Mutant(
        "the hand never lets go",
        HELM,
        "self._orders.mode is Mode.MANUAL and now_ns >= self._manual_until_ns",
        "False",
        f"{T}/test_helm.py::test_a_hand_that_lets_go_has_stopped",
    ),
    Mutant(
        "a loop that stood still drives on",
        LOOP,
        "paused_ns > self._metronome.period_ns + STALLED_AFTER_NS",
        "False",
        f"{T}/test_control_loop.py::test_a_loop_that_stood_still_disarms",
    ),
    Mutant(
        "a board that was reset is driven on",
        LOOP,
        "        if reset:\n",
        "        if False:\n",
        f"{T}/test_control_loop.py::test_a_board_that_was_reset_disarms",
    ),
    Mutant(
        "nobody is ever stuck",
        LOOP,
        "if (fault := self._stuck.judge(tick)) is not None:",
        "if (fault := self._stuck.judge(tick)) is not None and False:",
        f"{T}/test_control_loop.py::test_a_robot_that_is_stuck_disarms_and_waits_for_a_word",
    ),
    Mutant(
        "a robot that is stuck drives on by itself",
        LOOP,
        "self._stuck.judge(tick)) is not None:\n            self._helm.latch(fault.detail)\n",
        "self._stuck.judge(tick)) is not None:\n            self._helm.rest(tick.orders)\n",
        f"{T}/test_control_loop.py::test_a_robot_that_is_stuck_disarms_and_waits_for_a_word",
    ),
    Mutant(
        "noise is taken for motion",
        f"{ROBOT}/camera/stuck.py",
        "return ROUNDING**2 + (NOISE_MARGIN * noise / AREA_PX) ** 2",
        "return 0.0",
        f"{T}/test_stuck.py::test_a_picture_that_stands_still_for_3_s_of_driving_is_stuck",
    ),
    Mutant(
        "what moves a little stands still",
        f"{ROBOT}/camera/stuck.py",
        "return ROUNDING**2 + (NOISE_MARGIN * noise / AREA_PX) ** 2",
        "return 400.0",
        f"{T}/test_stuck.py::test_a_picture_that_changes_is_not",
    ),
    Mutant(
        "a robot that creeps is taken for one that is stuck",
        f"{ROBOT}/camera/stuck.py",
        "if still_ns < STILL_FOR_NS or abs(self._ways_m).max() < WAY_M:",
        "if still_ns < STILL_FOR_NS:",
        f"{T}/test_stuck.py::test_creeping_takes_as_long_as_half_a_metre",
    ),
    Mutant(
        "a command outlives its period by far",
        LOOP,
        "DEADLINE_SLACK_NS = 100_000_000",
        "DEADLINE_SLACK_NS = 900_000_000",
        f"{T}/test_control_loop.py::test_a_command_ends_soon_after_its_period",
    ),
    Mutant(
        "the camera does not guard a command",
        LOOP,
        "DriveCommand(joystick, deadline_ns, guard=self._camera.is_fresh)",
        "DriveCommand(joystick, deadline_ns)",
        f"{T}/test_control_loop.py::test_a_command_is_guarded_by_the_cameras_freshness",
    ),
    Mutant(
        "a model that failed drives on",
        LOOP,
        "            if self._pilot.has_given_up:\n",
        "            if False:\n",
        f"{T}/test_control_loop.py::test_a_model_that_answers_nonsense_stops_and_is_given_up",
    ),
    Mutant(
        "NaN is an answer",
        f"{ROBOT}/models/policy.py",
        "if not (math.isfinite(left) and math.isfinite(right)):",
        "if False:",
        f"{T}/test_policy.py",
    ),
    Mutant(
        "another session's command is obeyed",
        SERVICE,
        "if command.session_id != self._session_id:",
        "if False:",
        f"{T}/test_command_service.py::test_what_was_meant_for_another_moment_is_refused",
    ),
    Mutant(
        "an expired command is obeyed",
        SERVICE,
        "        if late_ns > 0:\n",
        "        if False:\n",
        f"{T}/test_command_service.py::test_what_was_meant_for_another_moment_is_refused",
    ),
    Mutant(
        "a command for next week is obeyed",
        SERVICE,
        "        if -late_ns > LONGEST_EXPIRY_NS:\n",
        "        if False:\n",
        f"{T}/test_command_service.py::test_nobody_has_a_command_for_later_in_his_pocket",
    ),
    Mutant(
        "the same bytes are obeyed twice",
        f"{ROBOT}/network/sender_numbers.py",
        "        if number <= last:\n",
        "        if False:\n",
        f"{T}/test_command_service.py::test_the_same_bytes_are_obeyed_once",
    ),
    Mutant(
        "run arms in spite of a fault",
        SERVICE,
        "        if faults:\n            found",
        "        if False:\n            found",
        f"{T}/test_command_service.py::test_run_with_a_fault_arms_nothing_and_says_why",
    ),
    Mutant(
        "a stop says stopped whatever the board says",
        SERVICE,
        "            standing=standing,\n",
        "            standing=True,\n",
        f"{T}/test_command_service.py::test_a_stop_is_confirmed_by_the_board_or_not_at_all",
    ),
    Mutant(
        "a command for another robot is obeyed",
        SERVICE,
        "        if command.robot_id != self._robot_id:\n",
        "        if False:\n",
        f"{T}/test_command_service.py::test_what_was_meant_for_another_moment_is_refused",
    ),
    Mutant(
        "a signature is not checked",
        f"{PROTOCOL}/model_manifest.py",
        "if not key.has_signed(_DOMAIN + signed.manifest, signed.signature):",
        "if False:",
        f"{T}/test_trust.py",
    ),
    Mutant(
        "a nonce is good twice",
        f"{ROBOT}/models/nonces.py",
        "return self._issued_s.pop(nonce, None) is not None",
        "return nonce in self._issued_s",
        f"{T}/test_trust.py::test_a_recorded_push_cannot_be_replayed",
    ),
    Mutant(
        "a downgrade needs no word",
        TRUST,
        "        if not manifest.allow_downgrade:\n",
        "        if False:\n",
        f"{T}/test_trust.py::test_a_downgrade_is_refused_unless_it_is_signed_as_one",
    ),
    Mutant(
        "another robot's model is taken",
        TRUST,
        "        if manifest.robot_id != self._robot_id:\n",
        "        if False:\n",
        f"{T}/test_trust.py::test_another_robots_model_is_refused",
    ),
    Mutant(
        "a file is renamed before it is synced",
        f"{PROTOCOL}/atomic_file.py",
        "            os.fsync(file)",
        "            if False:\n                os.fsync(file)",
        "tests/protocol/test_atomic_file.py::"
        "test_a_power_cut_at_any_call_leaves_the_old_file_or_the_new_one",
    ),
    Mutant(
        "a size that depends on the picture is let through",
        f"{PROTOCOL}/static_shapes.py",
        "inputs[index] not in known:",
        "False:",
        "tests/protocol/test_static_shapes.py::test_a_size_that_depends_on_the_picture_is_refused",
    ),
    Mutant(
        "the watchdog is fed though a part hangs",
        f"{ROBOT}/process/watchdog.py",
        'notify(f"STATUS={status}" if stuck else f"WATCHDOG=1\\nSTATUS={status}")',
        'notify(f"WATCHDOG=1\\nSTATUS={status}")',
        f"{T}/test_watchdog.py",
    ),
    Mutant(
        "a log that nobody reads blocks",
        f"{ROBOT}/process/journal.py",
        "            self._backlog.put_nowait(record)\n",
        "            self._backlog.put(record, timeout=2)\n",
        f"{T}/test_journal.py::test_a_log_that_nobody_reads_blocks_nobody",
    ),
    Mutant(
        "the model keeper logs under its lock",
        f"{ROBOT}/models/turn.py",
        "        if self._holder == threading.get_ident():\n",
        "        if False:\n",
        f"{T}/test_model_keeper.py",
    ),
    Mutant(
        "a crash is forgotten",
        f"{ROBOT}/process/last_end.py",
        "        if kind is None:\n",
        "        if True:\n",
        f"{T}/test_last_end.py",
    ),
    Mutant(
        "a revoked person stays",
        f"{ROBOT}/network/session_guard.py",
        "            if name not in self._rights:\n",
        "            if False:\n",
        f"{T}/test_session_guard.py",
    ),
    Mutant(
        "one person takes all places",
        f"{ROBOT}/network/session_guard.py",
        "if of_a_name[name] > MOST_A_NAME:",
        "if False:",
        f"{T}/test_session_guard.py",
    ),
    Mutant(
        "a policy goes on from what it remembered before a gap",
        LOOP,
        "        else:\n            self._pilot.forget()\n",
        "",
        f"{T}/test_pilot.py::test_whatever_comes_between_two_decisions_zeroes_it[camera_gap]",
    ),
    Mutant(
        "a policy goes on from what it remembered before a stop",
        LOOP,
        "            before.orders.epoch,\n",
        "            orders.epoch,\n",
        f"{T}/test_pilot.py::"
        "test_whatever_comes_between_two_decisions_zeroes_it[stop_and_run_between_two_beats]",
    ),
    Mutant(
        "a model goes on from what another one remembered",
        f"{ROBOT}/models/pilot.py",
        "            self.forget()\n            self._incoming.popleft()\n",
        "            self._incoming.popleft()\n",
        f"{T}/test_pilot.py::test_whatever_comes_between_two_decisions_zeroes_it[another_model]",
    ),
    Mutant(
        "a missed decision is not noticed by the policy's memory",
        LOOP,
        "            before.missed_ticks,\n",
        "            self._metronome.missed,\n",
        f"{T}/test_pilot.py::test_whatever_comes_between_two_decisions_zeroes_it[missed_decision]",
    ),
    Mutant(
        "a memory that is not finite is kept",
        f"{ROBOT}/models/policy.py",
        "if not np.isfinite(state).all():",
        "if False:",
        f"{T}/test_policy.py::test_a_memory_that_is_not_finite_is_a_failure",
    ),
    Mutant(
        "the loop waits for a card that hangs",
        f"{ROBOT}/recording/recorder.py",
        "self._backlog.put_nowait(tick)",
        "self._backlog.put(tick, timeout=2)",
        f"{T}/test_recorder.py::test_a_card_that_hangs_holds_up_nobody_and_what_is_lost_is_counted",
    ),
    Mutant(
        "a recording is not synced",
        f"{ROBOT}/recording/recorder.py",
        "        self._segment.sync()\n",
        "        pass\n",
        f"{T}/test_recorder.py::test_a_beat_is_on_the_card_within_a_second_though_no_other_follows",
    ),
    Mutant(
        "an order to move is taken during an update",
        SERVICE,
        "        if self._updating():",
        "        if False:",
        f"{T}/test_command_service.py::test_an_update_takes_no_order_but_a_stop",
    ),
    Mutant(
        "anybody's signature is good under a release",
        f"{PROTOCOL}/release_manifest.py",
        "if not has_signed(key, _DOMAIN + data, signature):",
        "if False:",
        "tests/protocol/test_release_manifest.py::"
        "test_other_keys_changed_bytes_and_damaged_signatures_are_refused",
    ),
    Mutant(
        "a file of a release may be another than was signed",
        f"{PROTOCOL}/release_archive.py",
        "if digest.hexdigest() != file.sha256:",
        "if False:",
        "tests/protocol/test_release_archive.py::test_any_changed_byte_is_noticed",
    ),
    Mutant(
        "root follows a link in the daemon's inbox",
        f"{UPDATER}/taking_in.py",
        "flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC",
        "flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC",
        f"{T}/test_taking_in.py::test_links_and_devices_in_the_inbox_are_not_followed",
    ),
    Mutant(
        "an armed robot is updated",
        f"{UPDATER}/update_steps.py",
        "    if before.is_armed:",
        "    if False:",
        f"{T}/test_update_steps.py::test_what_was_missing_before_is_not_held_against_it",
    ),
    Mutant(
        "a power cut in mid-trial leaves the new release",
        f"{UPDATER}/update_steps.py",
        "replace(folders.ledger, came_from=old, outcome=trying)",
        "replace(folders.ledger, outcome=trying)",
        f"{T}/test_update_steps.py::"
        "test_killed_at_any_step_a_whole_release_runs_and_the_next_update_works",
    ),
    Mutant(
        "a release that was rolled back is taken again",
        f"{PROTOCOL}/release_ledger.py",
        "if manifest.version in ledger.rejected:",
        "if False:",
        "tests/protocol/test_release_ledger.py::test_refusals_name_the_reason",
    ),
    Mutant(
        "a hand that has fallen silent holds ten times as long",
        f"{WORKSTATION}/by_hand/hand.py",
        "now_s - self._grip.arrived_s > FRESH_S:",
        "now_s - self._grip.arrived_s > 10 * FRESH_S:",
        f"{W}/test_hand.py::test_a_hand_holds_while_repeats_come_and_no_longer",
    ),
    Mutant(
        "a hand's old repeats count",
        f"{WORKSTATION}/by_hand/hand.py",
        "if travel_s - fastest_s > HELD_UP_S:",
        "if False:",
        f"{W}/test_hand.py::test_a_heap_of_old_repeats_after_a_tunnel_that_hung_counts_for_nothing",
    ),
    Mutant(
        "a hand that lets go is not passed on",
        f"{WORKSTATION}/by_hand/hand_drive.py",
        "            self._let_robot_go()\n",
        "            self._driving = None\n",
        f"{W}/test_hand.py::test_without_repeats_the_robot_is_let_go_once",
    ),
    Mutant(
        "a hand takes hold after a stop that it has not seen",
        f"{WORKSTATION}/link/remote_control.py",
        "if status.last_stop.count != seen_stops:",
        "if False:",
        f"{W}/test_remote_control.py::"
        "test_on_behalf_of_a_display_only_the_stop_that_it_showed_counts",
    ),
    Mutant(
        "any page in the browser may drive",
        f"{WORKSTATION}/console/door.py",
        'if (acts or origin is not None) and origin != f"http://{host}":',
        "if False:",
        f"{W}/test_door.py::test_a_page_of_another_site_is_refused",
    ),
    Mutant(
        "the console's token is not asked for",
        f"{WORKSTATION}/console/door.py",
        "if not secrets.compare_digest(given, self._token):",
        "if False:",
        f"{W}/test_door.py::test_without_the_token_nobody_gets_in",
    ),
)
