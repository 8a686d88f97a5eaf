"""Offer a service to agents as tools of the Model Context Protocol: `meshdeform mcp`. Needs the extra `mcp`."""
