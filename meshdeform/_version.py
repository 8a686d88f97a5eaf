"""The version, apart from the package, which for type checkers imports everything that it exports."""

__version__ = "0.1.0"
