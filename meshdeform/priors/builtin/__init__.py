"""Provide the builtin demonstration prior, a small text-conditioned diffusion model that ships in the package.

`vocabulary` defines the words that it knows and needs no torch; `prior.BuiltinPrior` is the model. `training` contains
the code that made the weights. `docs/model_card.md` describes what they can do, and
``python -m training.prior.sample`` shows it.
"""
