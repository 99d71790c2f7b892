"""What a scene is taken to be, and what is doubtful in it."""
