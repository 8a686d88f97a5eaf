"""Run jobs: a supervisor that never imports torch, and the worker process that it keeps running.

A thin shell over `meshdeform`: a message from RQ announces a job, and a claim in the record decides who runs it.
"""
