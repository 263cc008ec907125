"""What people look at: the terminal while recording, the report afterwards."""
