"""Practice: outline to stones, printed report, stock, design check, reliability."""
