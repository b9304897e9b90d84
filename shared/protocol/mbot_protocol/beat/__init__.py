"""One decision as a value: its message, its names, what is written of it and read again.

`beat` is the value, `fields` its flat names in JSON, `stages` its times, `changes` what is new in
words. `channels` says what stands in a recording, `writer` writes one; both are the robot's too.
`whole_chunks` and `recorded_drive` read, need compressors, and are the workstation's only.
"""
