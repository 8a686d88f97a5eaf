"""Run in processes of their own what reads users' files: without secrets, within bounds, ended with their parent.

`tasks` says what may be run, `protocol` what both sides say, `asking` is the parent, `program` the child, and `warm`
keeps children that have imported what an answer takes. It imports `errors`, and finds the kinds of job.
"""
