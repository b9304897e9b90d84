"""What a robot tells while it runs: received, timed, shown in a terminal."""
