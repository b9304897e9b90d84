"""Pictures as they come in and go out: files, streams, figures, a terminal."""
