"""Fit what a collection of shapes of one family has in common: parts, correspondences, and a machine that describes it.

Source: Huang, "Deep-Learned Generative Representations of 3D Shape Families", University of Massachusetts Amherst 2017,
chapter 3 and appendix C; Huang, Kalogerakis and Marlin 2015, "Analysis and Synthesis of 3D Shape Families via
Deep-Learned Generative Models of Surfaces", SGP. Written from the equations.
"""

NAMES = ("family_fit", "family_synthesize")
