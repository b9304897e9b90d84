"""How finely time is cut."""

TIMESTEP_S = 0.005
"""Against 1 ms, 6.5 s of maneuvers with full reversals end within 6 mm and 0.05 of 40 rad
(measured); a fifth of the work."""
