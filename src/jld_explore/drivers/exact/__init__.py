"""Exact search: a formula of the labellings that may still be better, and conflicts that rule out the others."""
