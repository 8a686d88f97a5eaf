"""The request document of a job, its parameters and presets. Torch-free."""
