"""Gateways: events out to what is no program of ours, one module per outside world."""
