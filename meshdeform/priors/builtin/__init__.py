"""The builtin demonstration prior: a small text-conditioned diffusion model that ships inside the package.

`grammar` says which prompts it understands and is free of torch; `prior.BuiltinPrior` is the model. How the
weights came to be: `families`, `dataset`, `train`; what they know: `docs/model_card.md` and
``python -m meshdeform.priors.builtin.training.sample``.
"""
