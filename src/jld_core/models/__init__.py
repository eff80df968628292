"""What is modelled, and the one policy how."""
