"""One module a command of `workstation`; heavy imports live inside the functions."""
