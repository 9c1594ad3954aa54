"""The paper from our own finite elements: one script for each figure or table, and the report on them."""
