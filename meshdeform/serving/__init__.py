"""Run the service on one machine: child processes, Redis, locks and devices."""
