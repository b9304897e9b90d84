"""The models: taking them in, trying them, keeping them, deciding with one, going back to another.

For others: `pilot.Pilot`, which answers for the model in use; `model_keeper.ModelKeeper`, which
chooses it; `model_service.ModelService`, which answers `models/...`; and what these are made with,
`model_directory`, `sequence_floors`, `trust`. The policy itself is the
protocol's: `mbot_protocol.policy.policy`.
"""
