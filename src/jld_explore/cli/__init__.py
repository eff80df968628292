"""Provide the command line `jld`."""
