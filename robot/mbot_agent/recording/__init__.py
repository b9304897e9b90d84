"""Recordings of drives on the robot's own card: written, kept in bounds, handed out.

For others: `recorder.Recorder` listens to ticks, `recording_service.RecordingService` answers
queries, and `recording_directory.RecordingDirectory` is what both work on. Recording may fail
in any way; the loop and a push never wait for it.
"""
