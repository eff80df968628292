"""Assemblies and results, drawn and shown."""
