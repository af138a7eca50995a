"""Timings beside other libraries: what the published figures are made with."""
