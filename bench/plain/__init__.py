"""Measure changes in plain words: a fixed list of sentences, and what each made of its asset."""
