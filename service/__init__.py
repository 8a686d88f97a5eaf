"""The HTTP API: a thin shell over `meshdeform`. It never imports torch or numpy."""
