"""What a command is given: files by their kind, drives as texts, columns of measured light."""
