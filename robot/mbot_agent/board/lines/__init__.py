"""Any microcontroller that speaks in lines of text (docs/other-robots.md), over a serial port."""
