"""What is said of models that are too simple, or wrong in a way that no list has."""
