"""What a command prints and draws."""
