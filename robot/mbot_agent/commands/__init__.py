"""What a person says to the robot over the network: `status`, `command`, `stop`.

For others: `command_service.CommandService` and `stop_service.StopService`.
"""
