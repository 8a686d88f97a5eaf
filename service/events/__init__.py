"""Follow jobs: streams of events, and requests that wait for the end of a job."""
