"""What may be labelled, under which limits, and what is counted."""
