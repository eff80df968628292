"""Labelling → Evaluation, in workers, with records on disk."""
