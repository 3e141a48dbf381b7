"""What a person orders, and what becomes of it: commands and the software stop, for terminal, page and verbs."""
