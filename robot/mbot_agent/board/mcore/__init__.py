"""The mCore board of an mBot: port, frames, acknowledgements, resets, banners and ARM."""
