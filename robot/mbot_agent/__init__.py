"""The daemon on the robot."""

from mbot_agent import libraries

libraries.prepare()
