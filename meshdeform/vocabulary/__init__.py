"""The nouns that have shapes, and the words of prompts. Neither numpy nor torch."""
