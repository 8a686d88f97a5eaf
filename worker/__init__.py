"""Runs jobs: a supervisor that never imports torch, and the worker process that it keeps running.

A thin shell over `meshdeform`; RQ tells it that there is a job, the record says whose it is.
"""
