"""Certificates and rights for the robots, people and routers of one fleet."""
