"""The record of jobs in SQL, the queue that notifies workers, and the reconciler that keeps the two consistent."""
