"""What a job asks for: the request document, its parameters and presets. Torch-free."""
