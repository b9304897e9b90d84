"""The camera: opening it and opening it again, the newest frame, and which frames are too bad.

For others: `capture.CaptureThread`, the camera as the loop sees it; and for `mbot-agent check`
`frame_sources.frame_source` and `picture_check.PictureCheck`.
"""
