"""Borders between the mechanisms of a map."""
def borders(): pass
