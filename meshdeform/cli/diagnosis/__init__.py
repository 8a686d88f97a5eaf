"""What `meshdeform doctor` looks at. Nothing here downloads anything, and nothing is left behind."""
